#!/bin/sh
# Measures what an idle daemon costs, CPU time and memory: fresh and after a session; then with an arm on a serial port and a camera
# behind libgphoto2 (both simulated by a process of their own): before they are opened, and while a session that holds both open waits
# for its lamp to warm up.
#
#   tests/idle.sh RIGD [SECONDS]
#
# Exit status 0: under 1 % of a core and under 40 MB, every time. SECONDS is how long each idle time lasts (60). What the camera worker,
# a process of its own, costs is printed beside it. Without a camera-worker beside RIGD the second half is skipped.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
rigd=${1:?usage: tests/idle.sh RIGD [SECONDS]}
seconds=${2:-60}

work=$(mktemp -d)
daemon=
devices=
end() { # of a process of this script, by its number
    [ -z "$1" ] || { kill "$1" 2>/dev/null && wait "$1" 2>/dev/null; } || true
}
clean_up() {
    end "$daemon"
    end "$devices"
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

# Waits for the first line of a file and prints what follows the words given.
first_line() {
    tries=0
    until line=$(sed -n "1s/^$2//p" "$1" 2>/dev/null) && [ -n "$line" ]; do
        tries=$((tries + 1))
        [ "$tries" -le 100 ] || { echo "$1 stays empty" >&2; exit 1; }
        sleep 0.1
    done
    echo "$line"
}

serve() { # a rig file
    end "$daemon"
    : > "$work/out"
    "$rigd" serve --config "$1" --listen 127.0.0.1:0 --data "$work/data" > "$work/out" &
    daemon=$!
    url=$(first_line "$work/out" 'listening on ')
}

# User and system time of a process, clock ticks.
ticks() { sed 's/.*) //' "/proc/$1/stat" | awk '{ print $12 + $13 }'; }
kilobytes() { awk '/^VmRSS/ { print $2 }' "/proc/$1/status"; }
# Ticks of a time in words, and whether that is within the bounds.
words() {
    awk -v what="$1" -v used="$2" -v hertz="$(getconf CLK_TCK)" -v seconds="$seconds" -v kb="$3" 'BEGIN {
        share = 100 * used / hertz / seconds
        printf "%s: %.2f %% of a core, %.1f MB\n", what, share, kb / 1000
        exit !(share < 1 && kb < 40000)
    }'
}

status=0
measure() {
    sleep 2
    worker=$(pgrep -P "$daemon" || true)
    before=$(ticks "$daemon")
    [ -z "$worker" ] || worker_before=$(ticks "$worker")
    sleep "$seconds"
    words "$1" $(($(ticks "$daemon") - before)) "$(kilobytes "$daemon")" || status=1
    # Printed only: libgphoto2 is not ours to bound.
    [ -z "$worker" ] || words "  its camera worker" $(($(ticks "$worker") - worker_before)) "$(kilobytes "$worker")" || true
}

serve "$root/rig-config/rigs/simulated.toml"
measure "fresh"
id=$("$rigd" session --url "$url" start)
"$rigd" session --url "$url" watch "$id" > "$work/watched"
measure "after a session"

if ! [ -x "$(dirname "$rigd")/camera-worker" ]; then
    echo "SKIPPED: arm and camera, as there is no camera-worker beside $rigd (cargo build --release -p camera-worker)"
    exit "$status"
fi
"$rigd" simulate camera --config "$root/rig-config/rigs/simulated.toml" --serve 0 --arm-link "$work/arm" > "$work/port" &
devices=$!
port=$(first_line "$work/port" '')
awk -v arm="$work/arm" -v camera="$port" '
    /^\[/ { section = $0 }
    section == "[simulation]" { next }
    section == "[arm]" && /^driver/ { print "driver = \"rigproto\"\nport = \"" arm "\""; next }
    section == "[camera]" && /^driver/ { print "driver = \"gphoto2\"\nport = \"" camera "\""; next }
    /^soak_s/ { print "soak_s = 3600"; next }
    { print }
' "$root/rig-config/rigs/simulated.toml" > "$work/rig.toml"
serve "$work/rig.toml"
measure "arm and camera attached"
id=$("$rigd" session --url "$url" start)
tries=0
until grep -q '"arm": "rig firmware' "$work/data/sessions/$id/manifest.json"; do
    tries=$((tries + 1))
    [ "$tries" -le 100 ] || { "$rigd" session --url "$url" show "$id" >&2; exit 1; }
    sleep 0.1
done
measure "lamp warming up, arm and camera open"
"$rigd" session --url "$url" show "$id" | grep -q '"state": "preflight"' || { echo "the session did not wait" >&2; exit 1; }
"$rigd" session --url "$url" abort "$id" > "$work/aborted"
exit "$status"
