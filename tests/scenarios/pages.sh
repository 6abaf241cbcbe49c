#!/bin/sh
# The pages beside the participant's trial with method D: methods A to D by keys and mouse, a newcomer's first visit,
# an emulated headset, the experimenter and a spectator, the replay of two trials. Lane `pages`.
#
#   tests/scenarios/pages.sh PATH_OF_PROACT OUTPUT_FOLDER
set -eu

proact=$1
output=$2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$output"
server=
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true' EXIT

# Starts the program with a page on a free port and waits for its address.
start() {
    "$proact" "$@" --no-browser --port 18190 >"$output/server.log" 2>&1 &
    server=$!
    tries=0
    while ! address=$(grep -om1 'http://[0-9.:]*/' "$output/server.log"); do
        tries=$((tries + 1))
        if [ "$tries" -gt 1200 ] || ! kill -0 "$server" 2>/dev/null; then
            cat "$output/server.log"
            echo "FAILED: \"$*\" printed no address within two minutes"
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

look() {
    mode=$1
    shift
    node "$here/../page/run.mjs" --url "$address" --out "$output/$mode" --mode "$mode" "$@"
}

start serve --no-record
look newcomer
look headset
look methods --methods BCD --timeout 290
stop

# Joint by joint the script cannot get into every corner of the box; with this arrangement it can.
start serve --no-record --seed 3
look methods --methods A --timeout 290
stop

start demo --method D --seed 1 --no-record
look experimenter
stop

rm -rf "$output/trials"
for seed in 1 2; do
    "$proact" demo --headless --method D --seed "$seed" --out "$output/trials/seed$seed" >/dev/null
done
start replay "$output/trials/seed1" "$output/trials/seed2" --page
look replay
stop
