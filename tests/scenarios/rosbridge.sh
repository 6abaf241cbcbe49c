#!/bin/sh
# rosbridge of the built program with clients that others wrote, roslib and roslibpy:
#
#   tests/scenarios/rosbridge.sh PATH_OF_PROACT OUTPUT_FOLDER [PYTHON_WITH_ROSLIBPY]
set -eu

proact=$1
output=$2
python=${3:-}
here=$(cd "$(dirname "$0")" && pwd)
port=19090
mkdir -p "$output"
"$proact" serve --method D --seed 1 --setup still --no-browser --no-record --port 18190 --rosbridge "$port" \
    >"$output/server.log" 2>&1 &
server=$!
trap 'kill "$server" 2>/dev/null || true' EXIT
tries=0
while ! grep -q '^rosbridge: ws://' "$output/server.log"; do
    tries=$((tries + 1))
    if [ "$tries" -gt 100 ] || ! kill -0 "$server" 2>/dev/null; then
        cat "$output/server.log"
        echo "FAILED: the server printed no address of rosbridge within 10 s"
        exit 1
    fi
    sleep 0.1
done

node "$here/../rosbridge/roslib.mjs" "ws://127.0.0.1:$port"
if [ -n "$python" ]; then
    "$python" "$here/../rosbridge/roslibpy_client.py" "$port"
else
    echo "roslibpy: skipped, it is not installed; ./proact peers installs it"
fi
if ! kill -0 "$server" 2>/dev/null; then
    cat "$output/server.log"
    echo "FAILED: the server ended"
    exit 1
fi
