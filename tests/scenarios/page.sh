#!/bin/sh
# The page in a headless Chromium, during a trial of the built program and then driven by mouse and keys:
#
#   tests/scenarios/page.sh PATH_OF_PROACT OUTPUT_FOLDER
set -eu

proact=$1
output=$2
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=tests/scenarios/serving.sh
. "$here/serving.sh"

start demo --method D --seed 1 --no-record
node "$here/../page/run.mjs" --url "$address" --out "$output/watch" --mode watch --score
stop

start serve --method D --seed 1 --setup still --no-record
node "$here/../page/run.mjs" --url "$address" --out "$output/interactive" --mode interactive
stop

# Where other machines can connect: who gets in.
node "$here/../page/run.mjs" --mode access --program "$proact" --out "$output/access"

# The page outlives the program: it comes back when the program does.
node "$here/../page/run.mjs" --mode restart --program "$proact" --out "$output/restart"
