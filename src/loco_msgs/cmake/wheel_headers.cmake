# SPDX-License-Identifier: Apache-2.0
# Include this file after rosidl_generate_interfaces().
#
# The Python wheels of the ROS message packages remember the Python and NumPy
# headers of the machine they were built on. Where those are missing, use this
# machine's headers instead. With an apt or source installation nothing matches.
get_property(imported DIRECTORY PROPERTY IMPORTED_TARGETS)
list(FILTER imported INCLUDE REGEX "__rosidl_generator_py$")
foreach(target IN LISTS imported)
  get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
  foreach(directory IN LISTS directories)
    if(NOT EXISTS "${directory}")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES
        "${Python3_INCLUDE_DIRS};${Python3_NumPy_INCLUDE_DIRS}")
    endif()
  endforeach()
endforeach()

# Its C files have names in common, so they cannot be compiled in one go.
set_target_properties(${PROJECT_NAME}__rosidl_generator_c PROPERTIES UNITY_BUILD OFF)
