#!/usr/bin/env bash
# Holds a running server against its own OpenAPI document: every operation, every check, examples to stateful chains.
# Usage: tests/oracles/schemathesis.sh VANTAGE-BINARY [schemathesis options]
# Needs VANTAGE_ORACLE_PYTHON, an interpreter with tests/oracles/requirements.txt; without it, says so and ends well.
set -euo pipefail
folder=$(cd "$(dirname "$0")" && pwd)
binary=$(realpath "${1:?the vantage binary}")
shift

if [ -z "${VANTAGE_ORACLE_PYTHON:-}" ]; then
    echo 'skipped: VANTAGE_ORACLE_PYTHON names no interpreter with schemathesis' >&2
    exit 0
fi

work=$(mktemp -d)
# Read below, perhaps before the server opens it.
: > "$work/out"
# A key is set, so that the checks of authorisation have something to look at.
key=schemathesis-0123456789
# Neither jobs nor runs that nobody ends may use up what is allowed of them.
VANTAGE_SERVER__API_KEY=$key VANTAGE_LIMITS__QUEUED_JOBS=1000000 VANTAGE_EXECUTION__MAX_RUNS=256 \
    "$binary" serve --listen 127.0.0.1:0 --data "$work/data" > "$work/out" 2> "$work/log" &
server=$!
trap 'kill "$server" 2> /dev/null; wait "$server" 2> /dev/null; rm -rf "$work"' EXIT

for _ in $(seq 100); do
    address=$(sed -n 's/.*listens on //p' "$work/out")
    [ -n "$address" ] && break
    kill -0 "$server" 2> /dev/null || { cat "$work/log" >&2; exit 1; }
    sleep 0.1
done

# It keeps a cache where it runs.
cd "$work"
"$VANTAGE_ORACLE_PYTHON" -m schemathesis.cli --config-file "$folder/schemathesis.toml" \
    run "$address/api/v1/openapi.json" --header "Authorization: Bearer $key" "$@"

# Nothing that was sent may have been the server's fault.
if grep -E 'ERROR|panicked' "$work/log" >&2; then
    echo 'the log above has faults of the server' >&2
    exit 1
fi
