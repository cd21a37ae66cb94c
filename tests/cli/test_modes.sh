# Cache modes: who writes what.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell.glb" "${quick[@]}" --overwrite)
kl render "${args[@]}" --out off.exr --cache-mode off >/dev/null
[[ ! -e cornell.klc ]] || fail "off wrote a cache"
kl render "${args[@]}" --out none.exr --indirect off >/dev/null
kl render "${args[@]}" --out path.exr --indirect path >/dev/null
[[ ! -e cornell.klc ]] || fail "path and off need no cache"
kl render "${args[@]}" --out new.exr >/dev/null
[[ -d cornell.klc ]] || fail "extend wrote no cache"
same_image off.exr new.exr >/dev/null
cp -r cornell.klc first.klc
kl render "${args[@]}" --size 64x64 --out frozen.exr --cache-mode freeze >/dev/null
kl render "${args[@]}" --size 64x64 --out filled.exr --cache-mode freeze-fill >/dev/null
rm cornell.klc/u-*.klu first.klc/u-*.klu # what was used
same_tree first.klc cornell.klc
kl render "${args[@]}" --out again.exr --cache-mode rebuild >/dev/null
same_image off.exr again.exr >/dev/null
kl render "${args[@]}" --size 64x64 --out more.exr --cache-mode append >/dev/null
[[ $(kl cache info cornell.klc --json | sed -n 's/.*"records": \([0-9]*\),.*/\1/p' | head -n 1) -gt \
    $(kl cache info first.klc --json | sed -n 's/.*"records": \([0-9]*\),.*/\1/p' | head -n 1) ]] ||
    fail "append did not add"
