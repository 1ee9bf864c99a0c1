# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: bags and a model in; the missing effect and the mended model out."""
