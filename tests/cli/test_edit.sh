# A scene that was edited since: the message names what differs.
. "$ROOT/tests/cli/lib.sh"
edit() {
    python3 "$ROOT/tests/data/edit_scene.py" "$SCENES/cornell.glb" "$@"
}
edit color.glb color red 0.1 0.1 0.6
edit moved.glb move 'short box' 0.1 0 0
edit dim.glb emission light 0.5
edit fewer.glb remove 'tall box'
kl bake "$SCENES/cornell.glb" "${quick[@]}" --cache c.klc >/dev/null
cp -r c.klc copy.klc
for scene in color moved dim fewer; do
    exits 4 kl render $scene.glb "${quick[@]}" --cache c.klc --out x.exr
done
exits 4 kl render "$SCENES/gallery.glb" "${quick[@]}" --cache c.klc --out x.exr
exits 4 kl render "$SCENES/cornell.glb" "${quick[@]}" --rays 256 --cache c.klc --out x.exr
same_tree copy.klc c.klc
