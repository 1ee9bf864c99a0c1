# SPDX-License-Identifier: Apache-2.0
# Include this file before rosidl_generate_interfaces().
#
# With -DPYTHON_ONLY=ON nothing is made for C++ programs, and the sources of a library are
# compiled in one go: a quarter of the time.
option(PYTHON_ONLY "Make what Python needs, and nothing else" OFF)
if(PYTHON_ONLY)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
  set(CMAKE_UNITY_BUILD ON)
  set(CMAKE_UNITY_BUILD_BATCH_SIZE 0)
endif()
