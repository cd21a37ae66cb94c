#!/bin/bash
# Run one script and compare: run.sh SCRIPT.sh WORK_FOLDER
#
# Beside SCRIPT.sh may lie SCRIPT.exit (exit code, else 0), SCRIPT.stdout.exact (standard output, else
# not looked at) and SCRIPT.stderr.glob (shell pattern for standard error, else it must be empty).
set -u -o pipefail

script=$1
work=$2
base=${script%.sh}
failed=0

rm -rf "$work"
mkdir -p "$work"
cd "$work" || exit 2
bash -eu -o pipefail "$script" >.stdout 2>.stderr
code=$?

want=0
[[ -e $base.exit ]] && want=$(<"$base.exit")
if [[ $code != "$want" ]]; then
    echo "exit code $code, expected $want"
    failed=1
fi
if [[ -e $base.stdout.exact ]] && ! diff -u "$base.stdout.exact" .stdout; then
    failed=1
fi
pattern=
[[ -e $base.stderr.glob ]] && pattern=$(<"$base.stderr.glob")
# shellcheck disable=SC2053 # the right side is a pattern
if [[ $(<.stderr) != $pattern ]]; then
    echo "standard error does not match '$pattern':"
    failed=1
fi
if [[ $failed != 0 ]]; then
    echo "--- stdout"
    cat .stdout
    echo "--- stderr"
    cat .stderr
fi
exit $failed
