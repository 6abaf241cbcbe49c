#!/bin/sh
# The pages beside the participant's trial with method D: a page that dies while it holds a gesture, methods A to D by keys and mouse, a newcomer's first visit,
# an emulated headset, the page of tracking, the experimenter and a spectator, a study with both of its pages, the replay of two trials,
# and each page in Debian's Firefox. Lane `pages`.
#
#   tests/scenarios/pages.sh PATH_OF_PROACT OUTPUT_FOLDER
set -eu

proact=$1
output=$2
here=$(cd "$(dirname "$0")" && pwd)
# shellcheck source=tests/scenarios/serving.sh
. "$here/serving.sh"

look() {
    mode=$1
    shift
    node "$here/../page/run.mjs" --url "$address" --out "$output/$mode" --mode "$mode" "$@"
}

start serve --no-record
look safety
look newcomer
look headset
look methods --methods ABCD --timeout 290
stop

# Method B by what the page tells, and by nothing else.
for seed in 1 2 3; do
    start serve --no-record --seed "$seed"
    look hint_bar
    stop
done

# Joint by joint the arrangement matters most: others too.
for seed in 2 3 4; do
    start serve --no-record --seed "$seed"
    look methods --methods A --timeout 290
    stop
done

start demo --method D --seed 1 --no-record
look experimenter
stop

# A study with both of its pages, by the keyboard alone, by the mouse alone and on a telephone: about ten minutes.
node "$here/../page/run.mjs" --mode study --program "$proact" --out "$output/study" --hands keys,mouse,finger

# Motion capture, played from a file of a shoulder that sways: five minutes at 100 Hz.
mkdir -p "$output/tracking"
awk 'BEGIN {
    print "body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked"
    for (k = 0; k < 30000; k++)
        printf "Shoulderpad,1,%d0000000,%.5f,1.0,%.5f,0,0,0,1,1\n", k, 2 + 0.03 * sin(k / 80), 1.4 + 0.01 * sin(k / 30)
}' >"$output/tracking/shoulder.csv"
start serve --no-record --mocap "file:$output/tracking/shoulder.csv/Shoulderpad"
look tracking
stop

# A headset's controller on the brace.
start serve --no-record --mocap headset:right_controller
look controller_tracking
stop

rm -rf "$output/trials"
for seed in 1 2; do
    "$proact" demo --headless --method D --seed "$seed" --out "$output/trials/seed$seed" >/dev/null
done
start replay "$output/trials/seed1" "$output/trials/seed2" --page
look replay
stop

# What a lab recorded, here from our own bag, which has the original's topics.
start replay "$output/trials/seed1/trial.bag" --page
look bag
stop

# The ghost arm of miniVIE's virtual limb, and the log of use.
node "$here/../page/run.mjs" --mode ghost --program "$proact" --out "$output/ghost"

# The calibration page with a simulated person at the armband, and a trial by the model that was made there: keys are
# prompts, the armband's EMG is recognised, and that moves the arm.
node "$here/../page/calibrate.mjs" --program "$proact" --out "$output/calibrate"
node "$here/../page/run.mjs" --mode limb_tests --program "$proact" --out "$output/limb_tests"
start serve --method D --seed 1 --setup still --no-record --emg-source synthetic --emg-model "$output/calibrate/model.json"
node "$here/../page/run.mjs" --url "$address" --out "$output/armband" --mode interactive
stop

# Each page in Debian's own Firefox, on a virtual screen.
xvfb-run -a -s "-screen 0 1400x1000x24" node "$here/../page/firefox.mjs" --program "$proact" --out "$output/firefox"
