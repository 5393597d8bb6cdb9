#!/bin/sh
# Fuzzes a simulated daemon from its own OpenAPI document: no 5xx, no answer against the schema, no undocumented status.
#
#   tests/schemathesis.sh RIGD [SECONDS] [VENV]
#
# RIGD is the program under test; SECONDS how long to fuzz (60); VENV where schemathesis is or will be installed
# (target/schemathesis). Exit status 0: nothing found.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
rigd=${1:?usage: tests/schemathesis.sh RIGD [SECONDS] [VENV]}
seconds=${2:-60}
venv=${3:-$root/target/schemathesis}
version=4.32.5

if ! "$venv/bin/schemathesis" --version 2>/dev/null | grep -qF "$version"; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --disable-pip-version-check "schemathesis==$version"
fi

work=$(mktemp -d)
daemon=
clean_up() {
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

# Time runs fast, so that sessions of every age are met.
sed 's/^speed = 40.0$/speed = 400.0/' "$root/rig-config/rigs/simulated.toml" > "$work/rig.toml"
"$rigd" serve --config "$work/rig.toml" --listen 127.0.0.1:0 --data "$work/data" > "$work/out" &
daemon=$!
tries=0
until url=$(sed -n 's/^listening on //p' "$work/out") && [ -n "$url" ]; do
    tries=$((tries + 1))
    [ "$tries" -le 100 ] || { echo "the daemon does not start" >&2; exit 1; }
    sleep 0.1
done

cd "$work"
status=0
SCHEMATHESIS_HOOKS=schemathesis_hooks PYTHONPATH="$root/tests" "$venv/bin/schemathesis" --config-file "$root/tests/schemathesis.toml" run "$url/openapi.json" --checks all --max-time "$seconds" \
    --request-timeout 30 --seed 1 --no-color || status=$?

# What it was asked to do must not have ended it, and it must end in order.
kill -TERM "$daemon"
wait "$daemon" || { echo "the daemon ended with status $?" >&2; status=1; }
daemon=
exit "$status"
