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

start demo --method D --seed 1 --no-record --time-limit 8
node "$here/../page/run.mjs" --url "$address" --out "$output/result_card" --mode result_card
stop

start serve --method D --seed 1 --setup still --no-record
node "$here/../page/run.mjs" --url "$address" --out "$output/interactive" --mode interactive
stop

# The first visit's bytes, another page that takes over, windows of all sizes, people without a mouse, without keys or with one
# switch, and a study as its experimenter and its participant see it.
for mode in download_size control_lease layout accessibility conduct study_forms; do
    start serve --method D --seed 1 --setup still --no-record
    node "$here/../page/run.mjs" --url "$address" --out "$output/$mode" --mode "$mode"
    stop
done

# The view of EMG beside a simulated armband.
"$proact" emg train --source synthetic --no-realtime --replace --out "$output/model.json" >"$output/train.log" 2>&1
start serve --no-record --setup still --seed 1 --time-limit 1800 --emg-source synthetic --emg-model "$output/model.json"
node "$here/../page/run.mjs" --url "$address" --out "$output/emg" --mode emg
stop

# Signals, intent, scores and views of the participant's page, beside the same.
start serve --method D --no-record --setup still --seed 1 --time-limit 1800 --emg-source synthetic --emg-model "$output/model.json"
node "$here/../page/run.mjs" --url "$address" --out "$output/signals" --mode signals
stop

# What was recorded, as a report in which each trial leads to its replay.
rm -rf "$output/trials"
for method in A D; do
    "$proact" demo --headless --method "$method" --seed 1 --time-limit 20 --out "$output/trials/$method" >"$output/trials.log" 2>&1
done
start analyze "$output/trials" --page
node "$here/../page/run.mjs" --url "$address" --out "$output/report" --mode report
stop

# Where other machines can connect: who gets in.
node "$here/../page/run.mjs" --mode access --program "$proact" --out "$output/access"

# The page outlives the program: it comes back when the program does.
node "$here/../page/run.mjs" --mode restart --program "$proact" --out "$output/restart"
