# shellcheck shell=sh
# shellcheck disable=SC2034,SC2154 # variables are shared with the script that sources it
# For scenarios that need the program with a page; sourced by them, with $proact and $output set.

mkdir -p "$output"
server=
trap '[ -z "$server" ] || kill "$server" 2>/dev/null || true' EXIT

# Starts the program with a page on a free port and waits for its address.
start() {
    "$proact" "$@" --no-browser --port 18090 >"$output/server.log" 2>&1 &
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
