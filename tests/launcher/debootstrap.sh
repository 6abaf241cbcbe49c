#!/bin/sh
# Proves ProACT's two commands on a bare machine: makes a minimal root of a release, copies the committed state in, and
# types `./proact demo` there as a new user would, then `./proact test` with the lanes that are named. Needs root,
# debootstrap and the network; the demo takes a quarter of an hour.
#
#   tests/launcher/debootstrap.sh RELEASE [LANES...]     such as bookworm, trixie, jammy, noble
set -eu

[ "$#" -gt 0 ] || {
    echo "debootstrap.sh: expected a release, such as trixie, and lanes if you like; got nothing" >&2
    exit 2
}
repository=$(cd "$(dirname "$0")/../.." && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"
release=$1
shift
make_root "$release"

git clone --quiet --no-local "$repository" "$root/proact"

echo "--- an ordinary user without sudo gets the command to run, and the exit code 3"
status=0
inside --userspec=1000:1000 "$root" /proact/proact demo >"$root/message" 2>&1 || status=$?
if [ "$status" != 3 ] || ! grep -q 'apt-get .*install .*libompl-dev' "$root/message"; then
    cat "$root/message"
    echo "FAILED: expected exit code 3 and an apt-get command, got exit code $status and the lines above"
    exit 1
fi

echo "--- as root: ./proact demo"
start=$(date +%s)
inside "$root" /proact/proact demo --headless --method D --seed 1 --out /trials --json >"$root/out"
echo "set-up, build and run took $(($(date +%s) - start)) s"
cat "$root/out"
# The machine contract: one JSON object.
python3 -c '
import json, sys
trial = json.load(open(sys.argv[1]))
blocks = len(trial["outcomes"])
if blocks != 4 or not 0 <= trial["on_target"] <= 4:
    sys.exit(f"FAILED: expected four outcomes and 0..4 on target, got {trial}")
print("on target: %d of 4, real-time factor %.1f" % (trial["on_target"], trial["real_time_factor"]))
' "$root/out"

echo "--- once more, with nothing missing"
start=$(date +%s)
inside "$root" /proact/proact "--version"
echo "that took $(($(date +%s) - start)) s"

if [ "$#" -gt 0 ]; then
    echo "--- as root: ./proact test $*"
    inside "$root" /proact/proact test "$@"
fi
