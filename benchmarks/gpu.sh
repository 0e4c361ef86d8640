#!/bin/sh
# Everything that wants a GPU, in calls of under nine minutes: benchmarks/gpu.sh OUT [CAPTURE]. Run it again until it
# exits with another status than 75.
root=$(cd "$(dirname "$0")/.." && pwd)
python="$root/.venv/bin/python"
[ -x "$python" ] || python=python3
exec "$python" "$root/benchmarks/gpu.py" "$@"
