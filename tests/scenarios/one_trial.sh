#!/bin/sh
# One trial from end to end, through the built program:
#
#   tests/scenarios/one_trial.sh PATH_OF_PROACT
set -eu

proact=$1
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

field() { # the value of a key of a JSON object in a file
    /usr/bin/python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))[sys.argv[2]])' "$1" "$2"
}

fail() {
    echo "FAILED: $*"
    exit 1
}

demo() { # seed, name
    "$proact" demo --headless --method D --seed "$1" --out "$work/$2" --json >"$work/$2.json"
}

# The second run of seed 1 has another trial beside it: what the machine does otherwise must not matter.
demo 1 alone
demo 1 beside &
beside=$!
demo 2 other
wait "$beside" || fail "the trial beside another one ended with $?"

alone=$(field "$work/alone.json" digest)
[ "$(field "$work/beside.json" digest)" = "$alone" ] ||
    fail "seed 1 gave $alone alone and $(field "$work/beside.json" digest) beside another trial"
[ "$(field "$work/other.json" digest)" != "$alone" ] || fail "seeds 1 and 2 gave the same digest $alone"
echo "ok  one seed, one digest; another seed, another"

"$proact" replay "$work/alone" || fail "the recorded trial does not replay"
echo "ok  the recorded trial replays"

# Flip one bit in the middle of the log. The original stays whole for the check of the bag.
cp -r "$work/alone" "$work/damaged"
/usr/bin/python3 - "$work/damaged/inputs.log" <<'PYTHON'
import sys
data = bytearray(open(sys.argv[1], "rb").read())
data[len(data) // 2] ^= 1
open(sys.argv[1], "wb").write(data)
PYTHON
if "$proact" replay "$work/damaged" >"$work/message" 2>&1; then
    cat "$work/message"
    fail "a log with a flipped bit replays as if nothing were wrong"
fi
grep -qE '(byte|offset) [0-9]+' "$work/message" || {
    cat "$work/message"
    fail "the complaint about a damaged log names no place in it"
}
echo "ok  a damaged log is refused: $(tail -n 1 "$work/message" | sed 's|.*/||')"

/usr/bin/python3 "$here/../bag/check_bag.py" "$work/alone/trial.bag" >"$work/bag.json" || fail "ROS's tools refuse the bag"
echo "ok  ROS's tools read $(field "$work/bag.json" messages) messages"
