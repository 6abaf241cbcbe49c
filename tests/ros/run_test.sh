#!/bin/sh
# Runs one test of a ROS graph and prints all of its output when it ends, so that two can run at a time.
#
#   tests/ros/run_test.sh RESULTS NAME [WORDS]     leaves RESULTS/NAME.passed or RESULTS/NAME.failed
here=$(cd "$(dirname "$0")" && pwd)
results=$1
name=$2
shift 2
label=$name$(printf %s "$*" | tr -c 'A-Za-z0-9' _)
start=$(date +%s)
if /usr/bin/python3 -W ignore "$here/$name.py" "$@" >"$results/$label.log" 2>&1; then end=passed; else end=failed; fi
: >"$results/$label.$end"
{
    echo "--- $name $*: $end after $(($(date +%s) - start)) s"
    cat "$results/$label.log"
} | cat
