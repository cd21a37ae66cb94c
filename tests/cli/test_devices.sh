# The host is always there.
. "$ROOT/tests/cli/lib.sh"
kl devices | head -n 1
kl devices --json | grep -q '"device": "embree"' || fail "JSON"
