#!/bin/sh
# The page in a headless Chromium, during a trial of the built program and then driven by mouse and keys:
#
#   tests/scenarios/page.sh PATH_OF_PROACT OUTPUT_FOLDER
set -eu

proact=$1
output=$2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$output"
server=
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true' EXIT

# Starts the program with a page on a free port and waits for its address.
start() {
    "$proact" "$@" --no-browser --no-record --port 18090 >"$output/server.log" 2>&1 &
    server=$!
    tries=0
    while ! address=$(grep -om1 'http://[0-9.:]*/' "$output/server.log"); do
        tries=$((tries + 1))
        if [ "$tries" -gt 100 ] || ! kill -0 "$server" 2>/dev/null; then
            cat "$output/server.log"
            echo "FAILED: \"$*\" printed no address within 10 s"
            exit 1
        fi
        sleep 0.1
    done
}

stop() {
    kill "$server"
    wait "$server" 2>/dev/null || true
    server=
}

start demo --method D --seed 1
node "$here/../page/run.mjs" --url "$address" --out "$output/watch" --mode watch --score
stop

start serve --method D --seed 1 --setup still
node "$here/../page/run.mjs" --url "$address" --out "$output/interactive" --mode interactive
stop

# The calibration page, with a simulated person at the armband.
node "$here/../page/calibrate.mjs" --program "$proact" --out "$output/calibrate"

# The page outlives the program: it comes back when the program does.
node "$here/../page/run.mjs" --mode restart --program "$proact" --out "$output/restart"
