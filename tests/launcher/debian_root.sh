# shellcheck shell=sh
# shellcheck disable=SC2016 # apt expands its own variables
# A minimal Debian 12, or another release of Debian or Ubuntu, to type commands in; sourced by the tests that need a bare machine.
#
# The machine decides where packages come from: its Debian archives, its certificates and the configuration of npm and
# Cargo are copied into the root. Nothing else of it is seen there.

# Skips where a root cannot be made, and else goes into a mount namespace of its own: every mount vanishes with the
# process, however it ends. Call it first, with the script and its words.
enter_namespace() {
    [ "$(id -u)" = 0 ] || {
        echo "skipped: only root can make a Debian root with debootstrap"
        exit 77
    }
    unshare --mount --propagation private true 2>/dev/null || {
        echo "skipped: this machine lets nobody make a mount namespace (a container without that right)"
        exit 77
    }
    if [ -z "${PROACT_DEBOOTSTRAP_INSIDE:-}" ]; then
        export PROACT_DEBOOTSTRAP_INSIDE=1
        exec unshare --mount --propagation private "$@"
    fi
}

finish_root() {
    umount "$root/proc" "$root/dev/pts" 2>/dev/null || true
    # Of network namespaces that tests made in the root.
    umount "$root"/run/netns/* "$root/run/netns" 2>/dev/null || true
    rm -rf "$root"
}

# Makes a bare root of a release in $root; it goes with the script. Without a mirror debootstrap's own is taken.
bootstrap() { # RELEASE [MIRROR]
    root=$(mktemp -d "${TMPDIR:-/tmp}/proact-$1.XXXXXX")
    # mktemp lets in nobody else, but an ordinary user must get in.
    chmod 755 "$root"
    trap finish_root EXIT
    trap 'exit 130' INT TERM

    echo "--- making a minimal $1 in $root"
    case $1 in
    bookworm) keys= ;;
    *) keys=--no-check-gpg ;; # Debian has no keyring of others; the root's own apt checks what it fetches
    esac
    # All of Ubuntu's releases are made by one script, which an older debootstrap does not have under the newer names.
    set -- "$1" "${2:-}"
    if [ ! -e "/usr/share/debootstrap/scripts/$1" ]; then
        set -- "$1" "${2:-http://archive.ubuntu.com/ubuntu}" /usr/share/debootstrap/scripts/jammy
    fi
    # shellcheck disable=SC2086 # none or one word
    debootstrap --variant=minbase $keys "$1" "$root" ${2:+"$2"} ${3:+"$3"} >"$root.log" 2>&1 || {
        tail -n 20 "$root.log"
        unreachable=$(grep 'Failed getting release file' "$root.log" || true)
        rm -f "$root.log"
        if [ -n "$unreachable" ]; then
            echo "skipped: the archive of $1 does not answer"
            exit 77
        fi
        echo "FAILED: debootstrap did not finish"
        exit 1
    }
    rm -f "$root.log"
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    for file in /etc/apt/apt.conf.d/99* /usr/local/share/ca-certificates/*; do
        if [ -f "$file" ]; then install -D -m 644 "$file" "$root$file"; fi
    done
    mount -t proc proc "$root/proc"
    # catkin build wants terminals for its jobs.
    mount -t devpts -o ptmxmode=0666 devpts "$root/dev/pts"
}

# Makes a Debian 12 in $root, or another release: with the archives that a new user of it has, of which this machine may
# name nearer ones for Debian 12.
make_root() { # RELEASE
    case $1 in
    bookworm)
        # The archives of this machine, and of them only Debian's own: a new user has no others.
        sources=$(apt-get indextargets --format '$(ORIGIN) $(REPO_URI) $(CODENAME) $(COMPONENT)' 'Created-By: Packages' |
            awk '$1 == "Debian" && $3 ~ /^bookworm/ && $4 == "main" { print "deb", $2, $3, $4 }' | sort -u)
        mirror=$(echo "$sources" | awk '$3 == "bookworm" { print $2; exit }')
        [ -n "$mirror" ] || {
            echo "FAILED: this machine's apt sources name no Debian bookworm archive; run apt-get update, or add one"
            exit 1
        }
        bootstrap bookworm "$mirror"
        ;;
    *)
        bootstrap "$1"
        mirror=$(awk '$1 == "deb" { print $2; exit }' "$root/etc/apt/sources.list")
        case $mirror in *ubuntu*) components="main universe" ;; *) components=main ;; esac
        sources=$(for suite in "$1" "$1-updates"; do echo "deb $mirror $suite $components"; done)
        ;;
    esac
    echo "$sources" >"$root/etc/apt/sources.list"
    for file in .npmrc .cargo/config.toml; do
        if [ -f "${HOME:-/root}/$file" ]; then install -D -m 600 "${HOME:-/root}/$file" "$root/root/$file"; fi
    done
}

# Runs a command in the root, in a plain environment with nothing of the caller's but the way to the network. Words
# before the root are chroot's.
inside() {
    env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb LANG=C.UTF-8 \
        ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} \
        ${no_proxy:+no_proxy="$no_proxy"} chroot "$@" </dev/null
}
