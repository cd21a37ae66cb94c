# One object's colour out of a hundred, in view of the camera: at least half of the records stay.
. "$ROOT/tests/cli/lib.sh"
args=(--camera exhibit --size 64x36 --spp 2 --error 0.02 --rays 64 --device embree --progress off)
python3 "$ROOT/tests/data/edit_scene.py" "$SCENES/exhibition.glb" red.glb color 'exhibit 12' 0.8 0.1 0.05
kl render "$SCENES/exhibition.glb" "${args[@]}" --cache c.klc --out before.exr >/dev/null
kl render red.glb "${args[@]}" --cache c.klc --out edited.exr >/dev/null 2>said
kl render red.glb "${args[@]}" --cache-mode off --out fresh.exr >/dev/null
had=$(sed -n 's/.*(material): of \([0-9]*\) records.*/\1/p' said)
kept=$(sed -n 's/.* records \([0-9]*\) kept.*/\1/p' said)
[[ $((2 * kept)) -ge $had ]] || fail "$kept of $had records kept"
kl compare edited.exr fresh.exr --json=edited.json >/dev/null
kl compare before.exr fresh.exr --json=before.json >/dev/null
awk -v e="$(value edited.json block8_relmse)" -v b="$(value before.json block8_relmse)" \
    'BEGIN { exit !(e <= 0.0001 && b > 10 * e) }' ||
    fail "block8_relmse $(value edited.json block8_relmse), without the edit $(value before.json block8_relmse)"
