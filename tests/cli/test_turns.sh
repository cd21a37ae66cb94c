# Two processes that want the same work take turns; two with different work go on side by side.
. "$ROOT/tests/cli/lib.sh"
bake=("$SCENES/cornell.glb" "${quick[@]}")
kl bake "${bake[@]}" --cache c.klc >first.txt &
kl bake "${bake[@]}" --cache c.klc >second.txt
wait $!
sort first.txt second.txt | grep -q ', 0 added' || fail "both gathered the same"
kl cache check c.klc >/dev/null
ls -A c.klc | grep -q claim && fail "a claim was left behind"
rm -rf c.klc
kl bake "${bake[@]}" --cache c.klc >/dev/null &
kl bake "${bake[@]}" --size 40x40 --cache c.klc >/dev/null
wait $!
kl cache check c.klc >/dev/null
kl render "${bake[@]}" --cache c.klc --cache-mode freeze --out a.exr >/dev/null
