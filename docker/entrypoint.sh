#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What follows the service's name in `docker compose run` goes to ./loco.
set -eu
exec /loco/loco "$@"
