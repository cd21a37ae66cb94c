# A moving scene that was edited since: the light is that of a fresh bake, never of the earlier
# edition; a frozen cache that has nothing of the edited instant is refused, with one line.
. "$ROOT/tests/cli/lib.sh"
args=("${quick[@]}" --overwrite --frames 1-2)
python3 "$ROOT/tests/data/edit_scene.py" "$SCENES/cornell-fast.glb" color.glb color red 0.1 0.1 0.6
python3 "$ROOT/tests/data/edit_scene.py" "$SCENES/cornell-fast.glb" dim.glb emission light 0.5
kl render "$SCENES/cornell-fast.glb" "${args[@]}" --cache c.klc --out first.####.exr >/dev/null
cp -r c.klc copy.klc
for scene in color dim; do
    exits 4 kl render $scene.glb "${args[@]}" --cache c.klc --cache-mode freeze --out x.####.exr
    same_tree copy.klc c.klc
done 2>lines
[[ $(wc -l <lines) == 2 && $(grep -c 'edited since' lines) == 2 ]] || fail "$(cat lines)"
for scene in color dim; do
    kl render $scene.glb "${args[@]}" --cache c.klc --out a.####.exr >/dev/null
    kl render $scene.glb "${args[@]}" --cache-mode off --out b.####.exr >/dev/null
    same_image a.0001.exr b.0001.exr >/dev/null
    same_image a.0002.exr b.0002.exr >/dev/null
done
# The first edition is whole, and unused instants do not hinder a prune.
kl render "$SCENES/cornell-fast.glb" "${args[@]}" --cache c.klc --cache-mode freeze --out again.####.exr >/dev/null
same_image first.0002.exr again.0002.exr >/dev/null
kl bake "$SCENES/cornell-fast.glb" "${quick[@]}" --frames 3 --cache c.klc >/dev/null
kl cache prune c.klc --unused >/dev/null
kl cache check c.klc >/dev/null
