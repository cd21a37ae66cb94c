# Every option is in docs/cli.md, every status in docs/errors.md.
. "$ROOT/tests/cli/lib.sh"
for command in render bake "cache info" "cache check" compare flicker scene devices sheet; do
    # shellcheck disable=SC2086 # two words
    kl $command --help
done | grep -o -- '--[a-z][a-z-]*' | sort -u >options
[[ $(wc -l <options) -gt 30 ]] || fail "options were not found"
while read -r option; do
    grep -q -- "\`$option[\` =]" "$ROOT/docs/cli.md" || echo "not in docs/cli.md: $option"
done <options
grep -o 'KL_ERR_[A-Z_]*' "$ROOT/src/base/status.h" | sort -u >statuses
[[ $(wc -l <statuses) -gt 5 ]] || fail "statuses were not found"
while read -r status; do
    grep -q "\`$status\`" "$ROOT/docs/errors.md" || echo "not in docs/errors.md: $status"
done <statuses
