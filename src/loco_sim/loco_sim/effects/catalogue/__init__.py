# SPDX-License-Identifier: Apache-2.0
"""The effects, one module per family; importing this package registers all of them."""

import importlib
import pkgutil

for _module in sorted(module.name for module in pkgutil.iter_modules(__path__)):
    importlib.import_module(f"{__name__}.{_module}")
