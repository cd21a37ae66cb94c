# A second run finds all it needs: no record is added, the picture is the same, the store untouched.
. "$ROOT/tests/cli/lib.sh"
kl render "$SCENES/cornell.glb" "${quick[@]}" --out a.exr --cache c.klc --report a.json >/dev/null
cp -r c.klc before.klc
kl render "$SCENES/cornell.glb" "${quick[@]}" --out b.exr --cache c.klc --report b.json >/dev/null
[[ $(value a.json added) -gt 0 ]] || fail "nothing was added"
[[ $(value b.json added) == 0 ]] || fail "the warm run added records"
[[ $(value b.json loaded) == $(value a.json added) ]] || fail "records were lost"
same_image a.exr b.exr >/dev/null
same_tree before.klc c.klc
kl cache check c.klc >/dev/null
kl cache info c.klc --json i.json >/dev/null
for key in records segments bytes generation scene_digest; do
    [[ -n $(value i.json $key) ]] || fail "no $key"
done
grep -q '"levels"' i.json && grep -q '"box"' i.json || fail "no levels or box"
