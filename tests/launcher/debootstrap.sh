#!/bin/sh
# Proves `./proact demo` on a bare Debian 12: makes a minimal root, copies the committed state in, and types the
# command there as a new user would. Needs root, debootstrap and the network; takes a quarter of an hour.
#
#   tests/launcher/debootstrap.sh [WORDS...]     the command given to ./proact, by default a headless demo
#
# The machine decides where packages come from: its Debian archives, its certificates and the configuration of
# npm and Cargo are copied into the root. Nothing else of it is seen there.
# shellcheck disable=SC2016 # apt expands its own variables
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
[ "$(id -u)" = 0 ] || {
    echo "skipped: only root can make a Debian root with debootstrap"
    exit 77
}

unshare --mount --propagation private true 2>/dev/null || {
    echo "skipped: this machine lets nobody make a mount namespace (a container without that right)"
    exit 77
}

# Inside a mount namespace of its own every mount vanishes with this process, however it ends.
if [ -z "${PROACT_DEBOOTSTRAP_INSIDE:-}" ]; then
    export PROACT_DEBOOTSTRAP_INSIDE=1
    exec unshare --mount --propagation private "$0" "$@"
fi

root=$(mktemp -d "${TMPDIR:-/tmp}/proact-debian.XXXXXX")
# mktemp lets in nobody else, but the ordinary user of the first check must get in.
chmod 755 "$root"
finish() {
    umount "$root/proc" 2>/dev/null || true
    rm -rf "$root"
}
trap finish EXIT
trap 'exit 130' INT TERM

echo "--- making a minimal Debian 12 in $root"
# The archives of this machine, and of them only Debian's own: a new user has no others.
sources=$(apt-get indextargets --format '$(ORIGIN) $(REPO_URI) $(CODENAME) $(COMPONENT)' 'Created-By: Packages' |
    awk '$1 == "Debian" && $3 ~ /^bookworm/ && $4 == "main" { print "deb", $2, $3, $4 }' | sort -u)
mirror=$(echo "$sources" | awk '$3 == "bookworm" { print $2; exit }')
[ -n "$mirror" ] || {
    echo "FAILED: this machine's apt sources name no Debian bookworm archive; run apt-get update, or add one"
    exit 1
}
debootstrap --variant=minbase bookworm "$root" "$mirror" >"$root.log" 2>&1 || {
    tail -n 20 "$root.log"
    rm -f "$root.log"
    echo "FAILED: debootstrap did not finish"
    exit 1
}
rm -f "$root.log"

echo "$sources" >"$root/etc/apt/sources.list"
cp /etc/resolv.conf "$root/etc/resolv.conf"
for file in /etc/apt/apt.conf.d/99* /usr/local/share/ca-certificates/*; do
    [ -f "$file" ] && install -D -m 644 "$file" "$root$file"
done
for file in .npmrc .cargo/config.toml; do
    [ -f "${HOME:-/root}/$file" ] && install -D -m 600 "${HOME:-/root}/$file" "$root/root/$file"
done
mount -t proc proc "$root/proc"

git clone --quiet --no-local "$repository" "$root/proact"

# A plain environment, with nothing of the caller's but the way to the network.
inside() {
    env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb LANG=C.UTF-8 \
        ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} \
        ${no_proxy:+no_proxy="$no_proxy"} chroot "$@" </dev/null
}

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
