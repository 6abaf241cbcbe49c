#!/bin/sh
# Tests of the launcher against stand-ins for apt, dpkg, sudo, cargo, node and npm: each writes down how it was
# called. PATH holds nothing but these and the plain tools, so that what the machine has does not matter. The
# real thing, on a bare Debian root, is debootstrap.sh beside this file.
# shellcheck disable=SC2016 # the stand-ins expand their own variables
set -eu

repository=$(cd "$(dirname "$0")/../.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
passed=0
failed=0

# --- Stand-ins ------------------------------------------------------------------------------------------

# A fresh copy of the launcher with its stand-ins. Switches are files in $work/state.
new_machine() {
    rm -rf "${work:?}/repo" "${work:?}/bin" "$work/state" "$work/elsewhere"
    mkdir -p "$work/repo/rust/bridge/web/src" "$work/repo/cpp" "$work/repo/ros1_ws" "$work/repo/tests" \
        "${work:?}/bin" "$work/state" "$work/elsewhere"
    cp "$repository/proact" "$work/repo/proact"
    printf 'rust-version = "1.89"\n' >"$work/repo/Cargo.toml"
    echo >"$work/repo/Cargo.lock"
    echo '{}' >"$work/repo/rust/bridge/web/package.json"
    echo '{}' >"$work/repo/rust/bridge/web/package-lock.json"
    echo 'page' >"$work/repo/rust/bridge/web/src/app.ts"

    for tool in awk basename cat chmod cksum dirname env find grep mkdir printf readlink rm sed sh sha256sum sort uname touch tr wc xargs; do
        ln -s "$(command -v "$tool")" "$work/bin/$tool"
    done
    echo 1000 >"$work/state/uid"
    echo 'rustc 1.95.0 (0 0)' >"$work/state/rustc"
    echo v20.1.0 >"$work/state/node"
    echo 1.96.0 >"$work/state/offer-cargo-web"
    echo 18.20.0 >"$work/state/offer-nodejs"
    touch "$work/state/lists" "$work/state/missing" "$work/state/unknown" "$work/calls"
    : >"$work/calls"

    make_stub id 'cat "$state/uid"'
    # Every package is installed but those in the file "missing".
    make_stub dpkg-query 'shift 2; for name in "$@"; do grep -qx "$name" "$state/missing" || echo "$name installed"; done'
    make_stub apt-cache '
case $1 in
show) [ -e "$state/lists" ] || exit 100
    shift 2; for name in "$@"; do
        grep -qx "$name" "$state/unknown" || printf "Package: %s\nInstalled-Size: 2000\nSize: 1000000\n\n" "$name"
    done ;;
policy) [ ! -e "$state/offer-$2" ] || printf "%s:\n  Installed: (none)\n  Candidate: %s\n" "$2" "$(cat "$state/offer-$2")" ;;
esac'
    make_stub apt-get '
case " $* " in
*" --print-uris "*) echo "x g++_1_amd64.deb 1000000 y" ;;
*" -s "*) ;;
*" update "*) echo "apt-get update" >>"$calls"; touch "$state/lists" ;;
*) echo "apt-get $*" >>"$calls"; [ ! -e "$state/apt-fails" ] || exit 100; : >"$state/missing"
   echo "rustc 1.96.0 (0 0)" >"$state/rustc"; echo v18.20.0 >"$state/node" ;;
esac'
    make_stub sudo 'echo "sudo" >>"$calls"; "$@"'
    make_stub rustc 'cat "$state/rustc"'
    make_stub cargo '
echo "cargo $* in $PWD" >>"$calls"
[ ! -e "$state/build-fails" ] || exit 101
mkdir -p "$CARGO_TARGET_DIR/release"
cat >"$CARGO_TARGET_DIR/release/proact" <<"PROGRAM"
#!/bin/sh
echo "program in $PWD:$(for word in "$@"; do printf " [%s]" "$word"; done)"
[ "${1:-}" != seven ] || exit 7
PROGRAM
chmod +x "$CARGO_TARGET_DIR/release/proact"'
    make_stub node 'cat "$state/node"'
    make_stub npm 'echo "npm $* in $PWD" >>"$calls"; case " $* " in *" ci "*) mkdir -p node_modules ;; *) mkdir -p dist dist-figures ;; esac'
}

make_stub() {
    printf '#!/bin/sh\nstate=%s calls=%s\n%s\n' "$work/state" "$work/calls" "$2" >"$work/bin/$1"
    chmod +x "$work/bin/$1"
}

# Runs the launcher; leaves $status, and its output in the files out and err.
launch() {
    launch_as "$work/repo/proact" "$@"
}

launch_as() {
    status=0
    env -i HOME="$work/home" PATH="$work/bin" TERM=dumb "$@" >"$work/out" 2>"$work/err" </dev/null || status=$?
}

# --- Checks ---------------------------------------------------------------------------------------------

check() { # description, then a command that must succeed
    description=$1
    shift
    if "$@"; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "FAILED: $description (status $status)"
        sed 's/^/    calls: /' "$work/calls"
        sed 's/^/    out:   /' "$work/out"
        sed 's/^/    err:   /' "$work/err"
    fi
}

status_is() { [ "$status" = "$1" ]; }
called() { grep -q -- "$1" "$work/calls"; }
not_called() { ! grep -q -- "$1" "$work/calls"; }
called_times() { [ "$(grep -c -- "$2" "$work/calls")" = "$1" ]; }
out_has() { grep -qF -- "$1" "$work/out"; }
err_has() { grep -qF -- "$1" "$work/err"; }
err_lacks() { ! grep -qF -- "$1" "$work/err"; }

# Nothing missing: no apt, one cargo, and the program gets every word as it was.
new_machine
launch query 'two words' --json
check "the program runs" status_is 0
check "its words arrive unsplit" out_has '[query] [two words] [--json]'
check "cargo builds the locked release in the repository" called "cargo build --release --locked -p proact-cli in $work/repo"
check "apt is left alone" not_called apt-get
check "the page is bundled before the program is built" sh -c "sed -n '1p' '$work/calls' | grep -q 'npm .* ci in'"
check "standard output carries nothing but the program's" [ "$(wc -l <"$work/out")" = 1 ]

# Again: the page is not bundled a second time.
: >"$work/calls"
launch query
check "nothing is done twice with npm" not_called npm
check "cargo still decides about the program" called "cargo build"
echo changed >"$work/repo/rust/bridge/web/src/app.ts"
launch query
check "a changed source bundles the page" called "run build"
check "a changed source installs no libraries" not_called " ci "
echo '{ }' >"$work/repo/rust/bridge/web/package-lock.json"
launch query
check "a changed lock file installs the libraries" called " ci "

# Features: the program is built with them, and what they need is looked for.
printf 'libdbus-1-dev\ncmake\n' >"$work/state/missing"
launch_as "PROACT_FEATURES=ble,lsl" "$work/repo/proact" emg
check "packages of features are missing, too" err_has "install -y --no-install-recommends libdbus-1-dev cmake"
: >"$work/state/missing"
launch_as "PROACT_FEATURES=ble,lsl" "$work/repo/proact" emg
check "features named in the environment are built in" called "-p proact-cli --features ble,lsl in"

# From another folder, through a symbolic link.
ln -s "$work/repo/proact" "$work/elsewhere/arm"
(cd "$work/elsewhere" && launch_as ./arm demo && echo "$status" >"$work/state/status")
check "the program keeps the caller's folder" out_has "program in $work/elsewhere: [demo]"

# Digests are updated in the repository, wherever the launcher is called.
launch update-digests 'a reason'
check "update-digests gets the repository and the reason as it was" out_has "[update-digests] [--repository] [$work/repo] [a reason]"
check "update-digests is told nothing of its old name" err_lacks "is now"
launch bless 'a reason'
check "bless is update-digests" out_has "[update-digests] [--repository] [$work/repo] [a reason]"
check "bless says what it is now" err_has "bless is now update-digests"

# A release and the site are made by scripts of their own, with the program that was built.
mkdir -p "$work/repo/docker" "$work/repo/docs"
for script in docker/release docs/site; do
    printf 'echo "%s: [$1] [$2] [${CARGO:-none}]"\n' "${script#*/}" >"$work/repo/$script.sh"
done
launch release
check "a release is made of the program, in the build folder" \
    out_has "release: [$work/repo/target/release/proact] [$work/repo/build/release] [none]"
launch release elsewhere
check "or in a folder of the caller's" out_has "[elsewhere]"
launch docs
check "the site is made with the cargo that was found" \
    out_has "site: [$work/repo/target/release/proact] [$work/repo/build/site] [$work/bin/cargo]"
launch release one two
check "a release has one folder" status_is 1

# A release has nodes where apt has what they need, unless the environment names other features.
check "a release has nodes" called "-p proact-cli --features ros in"
: >"$work/calls"
launch_as PROACT_FEATURES= "$work/repo/proact" release
check "no features mean none" called "-p proact-cli in $work/repo"
# A ROS under /opt/ros is found wherever the launcher runs.
if [ -d /opt/ros ]; then
    echo "skipped: this machine has a ROS under /opt/ros, so that no message packages are missing"
else
    printf 'ros-std-msgs\npython3-genpy\n' >"$work/state/missing"
    launch_as PROACT_FEATURES=ros "$work/repo/proact" release
    check "what nodes need is missing" err_has "install -y --no-install-recommends python3-genpy ros-std-msgs"
    launch_as PROACT_FEATURES=ros "$work/repo/proact" serve
    check "a command needs no Python classes" err_has "install -y --no-install-recommends ros-std-msgs"
    mkdir -p "$work/one/share/std_msgs/msg"
    launch_as PROACT_FEATURES=ros "CMAKE_PREFIX_PATH=$work/other:$work/one" "$work/repo/proact" serve
    check "a sourced ROS has the definitions" status_is 0
    launch_as PROACT_FEATURES=ros "ROSRUST_MSG_PATH=$work/one/share" "$work/repo/proact" serve
    check "so has a folder of packages" status_is 0
    cp "$work/state/missing" "$work/state/unknown"
    : >"$work/calls"
    launch release
    check "without what nodes need there are none" called "-p proact-cli in $work/repo"
    check "and it is said what is lacking" err_has "no ROS 1 nodes: apt has no ros-std-msgs python3-genpy"
    echo 0 >"$work/state/uid"
    launch node sim
    check "a node needs them" status_is 3
    check "and another ROS is named" err_has "install ROS One"
fi
new_machine

launch seven
check "the program's exit code comes through" status_is 7

# The build fails.
touch "$work/state/build-fails"
launch query
check "a failed build ends with 1" status_is 1
check "a failed build says so" err_has "the build failed"
check "a program of yesterday is not run in its place" [ ! -s "$work/out" ]

# Missing packages, neither root nor a terminal.
new_machine
printf 'libode-dev\nlibccd-dev\n' >"$work/state/missing"
launch demo
check "without root the exit code is 3" status_is 3
check "the one command is printed" err_has "apt-get -qq -o DPkg::Lock::Timeout=120 install -y --no-install-recommends libode-dev libccd-dev"
check "sizes are printed" err_has "libode-dev                    1.0 MB to fetch      2.0 MB on disk"
check "nothing is installed" not_called apt-get
check "sudo is not asked without a terminal" not_called sudo
check "nothing is built" not_called cargo

# The same as root.
new_machine
echo 0 >"$work/state/uid"
printf 'libode-dev\nlibccd-dev\n' >"$work/state/missing"
launch demo
check "root installs and goes on" status_is 0
check "exactly what is missing is installed" called 'no-install-recommends libode-dev libccd-dev$'
check "package lists that are there are not fetched again" not_called "apt-get update"

# Root on a machine without package lists, as in a fresh container.
new_machine
echo 0 >"$work/state/uid"
rm "$work/state/lists"
echo libode-dev >"$work/state/missing"
launch demo
check "empty package lists are fetched first" called "apt-get update"
check "then the package is installed" called 'no-install-recommends libode-dev$'

# apt fails: its status does not get lost, and it is tried again with fresh lists once.
new_machine
echo 0 >"$work/state/uid"
touch "$work/state/apt-fails"
echo libode-dev >"$work/state/missing"
launch demo
check "a failed installation ends with 3" status_is 3
check "it is tried twice, the second time with fresh lists" called_times 2 "no-install-recommends libode-dev"
check "nothing is built after a failed installation" not_called "cargo"

# Toolchains that are too old.
new_machine
echo 0 >"$work/state/uid"
echo 'rustc 1.63.0 (0 0)' >"$work/state/rustc"
echo v16.0.0 >"$work/state/node"
printf 'cargo-web\nrustc-web\nnodejs\nnpm\n' >"$work/state/missing"
launch demo
check "an old Rust and an old node are replaced by Debian's" called 'no-install-recommends cargo-web rustc-web nodejs npm$'
check "and the program is built with them" status_is 0

# Ubuntu's Rust has its number in the name. Package lists come first: without them nobody knows what there is.
new_machine
echo 0 >"$work/state/uid"
echo 'rustc 1.75.0 (0 0)' >"$work/state/rustc"
rm "$work/state/lists" "$work/state/offer-cargo-web"
echo 1.75.0 >"$work/state/offer-cargo"
echo 1.89.0 >"$work/state/offer-cargo-1.89"
printf 'cargo-1.89\nrustc-1.89\n' >"$work/state/missing"
launch demo
check "the Rust of Ubuntu's numbered packages is taken" called 'no-install-recommends cargo-1.89 rustc-1.89$'
check "after the package lists were fetched" sh -c "sed -n 1p '$work/calls' | grep -qx 'apt-get update'"

# A release whose Rust and node are too old: both are fetched into the build folder, without root, and kept.
old_release() {
    new_machine
    echo 'rustc 1.63.0 (0 0)' >"$work/state/rustc"
    echo v12.0.0 >"$work/state/node"
    echo 1.85.0 >"$work/state/offer-cargo-web"
    echo 12.22.0 >"$work/state/offer-nodejs"
    make_stub curl '
echo "curl $*" >>"$calls"
for file in "$@"; do :; done
case $file in
*.sha256) if [ -e "$state/damaged" ]; then echo 0123; else sha256sum "${file%.sha256}"; fi >"$file" ;;
*)  cat >"$file" <<"INSTALLER"
#!/bin/sh
bin=$RUSTUP_HOME/toolchains/1.89.0-fake/bin
mkdir -p "$bin"
printf "#!/bin/sh\necho rustc 1.89.0\n" >"$bin/rustc"
cp "$(command -v cargo)" "$bin/cargo"
chmod +x "$bin/rustc"
INSTALLER
esac'
    ln -s "$(command -v cp)" "$work/bin/cp"
}
old_release
mkdir -p "$work/repo/build/node/bin"
printf '#!/bin/sh\necho v22.20.0\n' >"$work/repo/build/node/bin/node"
cp "$work/bin/npm" "$work/repo/build/node/bin/npm"
chmod +x "$work/repo/build/node/bin/node"
launch query
check "a Rust is fetched where apt's is too old" called 'curl .*rustup-init.sha256'
check "and the program is built with it and the node that is kept" status_is 0
check "apt is not asked" not_called apt-get
: >"$work/calls"
launch query
check "it is fetched once" not_called curl

old_release
touch "$work/state/damaged"
launch query
check "an installer that arrived damaged is refused" status_is 1
check "and it is said what was expected" err_has "not 0123"
check "it is not run" [ ! -e "$work/repo/build/rust/toolchains" ]

# With a terminal: one question.
if command -v script >/dev/null; then
    for answer in n y; do
        new_machine
        echo libode-dev >"$work/state/missing"
        status=0
        echo "$answer" | script -qec "env -i HOME=$work/home PATH=$work/bin TERM=dumb $work/repo/proact demo" /dev/null \
            >"$work/out" 2>&1 || status=$?
        : >"$work/err"
        check "the question is asked once" [ "$(grep -c 'install them with sudo' "$work/out")" = 1 ]
        if [ "$answer" = n ]; then
            check "no means 3" status_is 3
            check "no means no sudo" not_called sudo
        else
            check "yes installs and goes on" status_is 0
            check "yes uses sudo once" called_times 1 '^sudo$'
        fi
    done
fi

# Help builds nothing.
new_machine
launch
check "without a word there is help" out_has "./proact demo"
check "help builds nothing" not_called cargo
check "help succeeds" status_is 0

# A lane that does not exist.
new_machine
cp "$repository/tests/lanes.sh" "$work/repo/tests/lanes.sh"
launch test nonsense
check "an unknown lane is refused" status_is 1
check "and the lanes are named" err_has "some of: format"
echo shellcheck >"$work/state/missing"
echo shellcheck >"$work/state/unknown"
launch test shell
check "a lane whose packages apt has not is skipped" out_has "0 passed, 0 failed, 1 skipped"
check "and the package is named" err_has "apt has no shellcheck"
check "a skipped lane is no failure" status_is 0
check "an ordinary user's lists stay as they are" not_called "apt-get update"
echo 0 >"$work/state/uid"
launch test shell
check "root's lists are fetched anew before a lane is skipped" called "apt-get update"
launch test --list
check "lanes can be listed" out_has "short: format"

echo "launcher: $passed passed, $failed failed"
[ "$failed" = 0 ]
