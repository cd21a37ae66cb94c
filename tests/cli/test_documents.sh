# Every option is in docs/cli.md, every status in docs/errors.md; every tool of the cache writes JSON; every invariant
# of docs/cache_format.md is named by a test.
. "$ROOT/tests/cli/lib.sh"
tools=(info check merge prune dump diff view)
for command in render bake "${tools[@]/#/cache }" compare flicker scene devices sheet; do
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
for tool in "${tools[@]}"; do
    kl cache "$tool" --help | grep -q -- --json || echo "cache $tool: no --json"
done
# "static void name(void **state) /* 1, 5, 6 */"
cat "$ROOT"/tests/unit/test_s*.c "$ROOT"/tests/crash/test_*.c |
    sed -n 's|^static void .*(void \*\*state) /\* \([0-9, ]*\) \*/$|\1|p' | tr ', ' '\n\n' | sort -u >named
sed -n '/^## 1\. /,/^## 2\. /s/^\([0-9]*\)\. .*/\1/p' "$ROOT/docs/cache_format.md" >invariants
[[ $(wc -l <invariants) -ge 13 ]] || fail "invariants were not found"
while read -r number; do
    grep -qx "$number" named || echo "no test names invariant $number of docs/cache_format.md"
done <invariants
