#!/bin/sh
# The browser tests again and again beside busy cores, until one fails: tests/reports/repeat_browser.sh [TIMES=50] [BUSY=2]
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
set -- "${1:-50}" # the report that is opened is made once for all turns
for _ in $(seq "$1"); do
    set -- "$@" tests/bench/test_pick_page.py tests/reports/test_page.py
done
shift
"$python" -m pytest -x -p no:cacheprovider --keep-duplicates "$@"
