# SPDX-License-Identifier: Apache-2.0
"""The effects, one family a module; importing this package registers every module in it."""

import importlib
import pkgutil

for _module in sorted(module.name for module in pkgutil.iter_modules(__path__)):
    importlib.import_module(f"{__name__}.{_module}")
