#!/bin/sh
# The browser tests again and again beside busy cores: tests/reports/repeat_browser.sh [TIMES=50] [BUSY=2]
set -eu
cd "$(dirname "$0")/../.."
python=.venv/bin/python
[ -x "$python" ] || python=python3
busy=
for _ in $(seq "${2:-2}"); do
    sh -c 'while :; do :; done' &
    busy="$busy $!"
done
trap 'kill $busy' EXIT
for turn in $(seq "${1:-50}"); do
    "$python" -m pytest -q -p no:cacheprovider tests/bench/test_pick_page.py tests/reports/test_page.py || {
        echo "turn $turn failed"
        exit 1
    }
    echo "turn $turn passed"
done
