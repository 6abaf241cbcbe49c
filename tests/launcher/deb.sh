#!/bin/sh
# shellcheck disable=SC2016 # the shells of the root expand their own variables
# Proves the packages of a release on a bare Debian 12 without compilers: installs the .deb with apt, runs a trial
# within a minute, looks for manual pages and completions, removes it, and tries the tarball with what it says it
# needs. Needs root, debootstrap and the network; takes two minutes.
#
#   tests/launcher/deb.sh DIR     the folder that `./proact release` wrote
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
release=$(cd "$1" && pwd)
# shellcheck source=tests/launcher/debian_root.sh
. "$repository/tests/launcher/debian_root.sh"
enter_namespace "$0" "$release"

# From `apt install` to the end of the first trial, s.
most_secs=60

refuse() {
    echo "FAILED: $*"
    exit 1
}

(cd "$release" && sha256sum --check --quiet SHA256SUMS) || refuse "the checksums"
set -- "$release"/proact_*.deb
if [ "$#" != 1 ] || [ ! -f "$1" ]; then refuse "expected one .deb in $release, got: $*"; fi
deb=$1
make_root bookworm
cp "$deb" "$root/proact.deb"
# Where anybody may leave trials.
mkdir -m 1777 "$root/trials"
inside "$root" apt-get -qq update
inside "$root" sh -c 'command -v cc || command -v rustc || command -v node' && refuse "the root has a compiler or node"
inside "$root" sh -c 'find / -xdev \( -path /proc -o -path /tmp -o -path /trials -o -path /var/lib/apt -o -path /var/cache \) -prune -o -print | sort' >"$root.before"
trap 'rm -f "$root.before" "$root.after"; finish_root' EXIT

echo "--- apt install ./proact.deb"
start=$(date +%s%N)
inside "$root" env DEBIAN_FRONTEND=noninteractive apt-get -y -qq --no-install-recommends install /proact.deb >"$root/log" 2>&1 || {
    tail -n 20 "$root/log"
    refuse "apt could not install the package"
}
installed=$(($(date +%s%N) - start))
inside --userspec=1000:1000 "$root" proact demo --headless --seed 1 --out /trials/first --json >"$root/out" ||
    refuse "proact demo --headless"
took=$(($(date +%s%N) - start))
printf 'apt install took %d.%d s, install and first trial %d.%d s, %s packages\n' $((installed / 1000000000)) $((installed / 100000000 % 10)) \
    $((took / 1000000000)) $((took / 100000000 % 10)) "$(grep -c '^Setting up ' "$root/log")"
[ "$took" -le $((most_secs * 1000000000)) ] || refuse "more than $most_secs s"
grep -q '"digest":"' "$root/out" || refuse "the trial has no digest: $(cat "$root/out")"

echo "--- version, manual pages, completions, data"
inside "$root" proact --version
inside "$root" proact --version | grep -q '^OMPL 1' || refuse "the version names no OMPL"
inside "$root" sh -c 'zcat /usr/share/man/man1/proact-study-run.1.gz' | grep -q 'goes on from the last event' || refuse "proact-study-run(1)"
inside "$root" bash --norc -c '. /usr/share/bash-completion/completions/proact
    COMP_WORDS=(proact dem) COMP_CWORD=1; _proact proact dem proact; [ "${COMPREPLY[*]}" = demo ]' || refuse "completion in bash"
for file in zsh/vendor-completions/_proact fish/vendor_completions.d/proact.fish doc/proact/copyright; do
    [ -s "$root/usr/share/$file" ] || refuse "/usr/share/$file is not there"
done
# The arm for a lab to copy is the one inside the program: the same trial to the last bit. The method is a program in Python.
inside "$root" proact demo --headless --seed 1 --arm /usr/share/proact/arms/mpl_right --out /trials/copied --json >"$root/copied" ||
    refuse "a trial with the arm in /usr/share/proact"
cmp "$root/trials/first/digests.log" "$root/trials/copied/digests.log" || refuse "another digest with the arm in /usr/share/proact"
inside "$root" proact demo --headless --seed 1 --task /usr/share/proact/tasks/three_cubes.toml --time-limit 3 --out /trials/cubes >"$root/log" 2>&1 || {
    cat "$root/log"
    refuse "a trial of the task in /usr/share/proact"
}

echo "--- apt remove leaves nothing"
inside "$root" sh -c 'apt-get -y -qq purge proact && apt-get -y -qq --purge autoremove' >"$root/log" 2>&1 || {
    tail -n 20 "$root/log"
    refuse "apt could not remove the package"
}
inside "$root" sh -c 'find / -xdev \( -path /proc -o -path /tmp -o -path /trials -o -path /var/lib/apt -o -path /var/cache \) -prune -o -print | sort' >"$root.after"
left=$(comm -13 "$root.before" "$root.after" | grep -v -e '^/var/log/' -e '^/var/lib/dpkg/' -e '^/var/lib/systemd' -e '^/\(log\|out\|copied\)$' || true)
[ -z "$left" ] || refuse "these are left: $left"

echo "--- the tarball, with what its file NEEDS names"
set -- "$release"/proact-*-linux-gnu.tar.gz
start=$(date +%s%N)
mkdir "$root/opt/proact"
tar -xzf "$1" --strip-components=1 -C "$root/opt/proact"
inside "$root" sh -c 'DEBIAN_FRONTEND=noninteractive apt-get -y -qq --no-install-recommends install $(sed "s/ .*//" /opt/proact/NEEDS) >/log 2>&1' ||
    refuse "the packages of NEEDS"
inside --userspec=1000:1000 "$root" /opt/proact/bin/proact demo --headless --seed 1 --out /trials/unpacked --json >"$root/unpacked" ||
    refuse "the tarball's program"
took=$(($(date +%s%N) - start))
printf 'unpacking, apt and the first trial took %d.%d s\n' $((took / 1000000000)) $((took / 100000000 % 10))
cmp "$root/trials/first/digests.log" "$root/trials/unpacked/digests.log" || refuse "another digest with the tarball's program"
inside "$root" sh -c 'DEBIAN_FRONTEND=noninteractive apt-get -y -qq install man-db >/log 2>&1; MANPAGER=cat man -M /opt/proact/share/man proact-demo' |
    grep -q -- --headless || refuse "man proact-demo"
echo "deb: all passed"
