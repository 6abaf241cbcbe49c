#!/bin/sh
# Proves `./proact demo` on a bare Debian 12: makes a minimal root, copies the committed state in, and types the
# command there as a new user would. Needs root, debootstrap and the network; takes a quarter of an hour.
#
#   tests/launcher/debootstrap.sh [WORDS...]     the command given to ./proact, by default a headless demo
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$@"
make_root

git clone --quiet --no-local "$repository" "$root/proact"

echo "--- an ordinary user without sudo gets the command to run, and the exit code 3"
status=0
inside --userspec=1000:1000 "$root" /proact/proact demo >"$root/message" 2>&1 || status=$?
if [ "$status" != 3 ] || ! grep -q 'apt-get .*install .*libompl-dev' "$root/message"; then
    cat "$root/message"
    echo "FAILED: expected exit code 3 and an apt-get command, got exit code $status and the lines above"
    exit 1
fi

[ "$#" -gt 0 ] || set -- demo --headless --method D --seed 1 --out /trials --json
echo "--- as root: ./proact $*"
start=$(date +%s)
inside "$root" /proact/proact "$@" >"$root/out"
echo "set-up, build and run took $(($(date +%s) - start)) s"
cat "$root/out"

echo "--- once more, with nothing missing"
start=$(date +%s)
inside "$root" /proact/proact "--version"
echo "that took $(($(date +%s) - start)) s"

# The machine contract: one JSON object. Commands given by hand may print what they like.
case " $* " in
*" demo "*" --json "*)
    python3 -c '
import json, sys
trial = json.load(open(sys.argv[1]))
blocks = len(trial["outcomes"])
if blocks != 4 or not 0 <= trial["on_target"] <= 4:
    sys.exit(f"FAILED: expected four outcomes and 0..4 on target, got {trial}")
print("on target: %d of 4, real-time factor %.1f" % (trial["on_target"], trial["real_time_factor"]))
' "$root/out"
    ;;
esac
