#!/bin/sh
# Measures what an idle daemon costs: CPU time and memory, fresh and after a session.
#
#   tests/idle.sh RIGD [SECONDS]
#
# Exit status 0: under 1 % of a core and under 40 MB, both times. SECONDS is how long each idle time lasts (60).
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
rigd=${1:?usage: tests/idle.sh RIGD [SECONDS]}
seconds=${2:-60}

work=$(mktemp -d)
daemon=
clean_up() {
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

"$rigd" serve --config "$root/rig-config/rigs/simulated.toml" --listen 127.0.0.1:0 --data "$work/data" > "$work/out" &
daemon=$!
tries=0
until url=$(sed -n 's/^listening on //p' "$work/out") && [ -n "$url" ]; do
    tries=$((tries + 1))
    [ "$tries" -le 100 ] || { echo "the daemon does not start" >&2; exit 1; }
    sleep 0.1
done

# User and system time of the daemon, clock ticks.
ticks() { sed 's/.*) //' "/proc/$daemon/stat" | awk '{ print $12 + $13 }'; }

status=0
measure() {
    sleep 2
    before=$(ticks)
    sleep "$seconds"
    used=$(($(ticks) - before))
    kilobytes=$(awk '/^VmRSS/ { print $2 }' "/proc/$daemon/status")
    awk -v what="$1" -v used="$used" -v hertz="$(getconf CLK_TCK)" -v seconds="$seconds" -v kb="$kilobytes" 'BEGIN {
        share = 100 * used / hertz / seconds
        printf "%s: %.2f %% of a core, %.1f MB\n", what, share, kb / 1000
        exit !(share < 1 && kb < 40000)
    }' || status=1
}

measure "fresh"
id=$("$rigd" session --url "$url" start)
"$rigd" session --url "$url" watch "$id" > "$work/watched"
measure "after a session"
exit "$status"
