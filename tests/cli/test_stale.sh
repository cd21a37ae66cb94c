# A cache of another scene, and a damaged one: exit code 4, and nothing is touched.
. "$ROOT/tests/cli/lib.sh"
kl bake "$SCENES/cornell.glb" "${quick[@]}" --cache c.klc >/dev/null
cp -r c.klc copy.klc
exits 4 kl render "$SCENES/furnace.glb" "${quick[@]}" --cache c.klc --out x.exr
exits 4 kl render "$SCENES/cornell.glb" "${quick[@]}" --rays 256 --cache c.klc --out x.exr
same_tree copy.klc c.klc
segment=$(ls copy.klc)
printf 'XXXX' | dd of="copy.klc/$segment" bs=1 seek=5000 conv=notrunc status=none
exits 4 kl cache check copy.klc >/dev/null
kl cache check c.klc | grep -q 'c.klc: whole' || fail "check"
