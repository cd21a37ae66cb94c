# A scene that was edited since: what depends on the edit is gathered again, the image is that of a
# fresh bake within the error that was asked for, and the line names what differs. Another scene and
# other settings are refused.
. "$ROOT/tests/cli/lib.sh"
quick=(--size 48x32 --spp 2 --error 0.02 --rays 256 --device embree --progress off --overwrite)
edit() {
    python3 "$ROOT/tests/data/edit_scene.py" "$SCENES/cornell.glb" "$@"
}
# near A B: blocks of pixels differ by less than half of --error, squared.
near() {
    kl compare "$1" "$2" --json=near.json
    awk -v e="$(value near.json block8_relmse)" 'BEGIN { exit !(e <= 0.0001) }' ||
        fail "$1 and $2: block8_relmse $(value near.json block8_relmse)"
}
edit color.glb color red 0.1 0.1 0.6
edit moved.glb move 'short box' 0.1 0 0
edit dim.glb emission light 0.5
edit fewer.glb remove 'tall box'
kl bake "$SCENES/cornell.glb" "${quick[@]}" --cache c.klc >/dev/null
cp -r c.klc copy.klc
exits 4 kl render "$SCENES/gallery.glb" "${quick[@]}" --cache c.klc --out x.exr
exits 4 kl render "$SCENES/cornell.glb" "${quick[@]}" --rays 1024 --cache c.klc --out x.exr
kl render color.glb "${quick[@]}" --cache c.klc --cache-mode freeze --out x.exr >/dev/null
same_tree copy.klc c.klc
for scene in color moved dim fewer; do
    rm -rf edit.klc
    cp -r c.klc edit.klc
    kl render $scene.glb "${quick[@]}" --cache edit.klc --out $scene.exr >/dev/null
    kl render $scene.glb "${quick[@]}" --cache-mode off --out fresh.exr >/dev/null
    near $scene.exr fresh.exr >/dev/null
    kl cache check edit.klc >/dev/null
    # The cache is of the edited scene now.
    kl render $scene.glb "${quick[@]}" --cache edit.klc --out again.exr >/dev/null
    same_image $scene.exr again.exr >/dev/null
done
# Back again, from the last edit.
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache edit.klc --out back.exr >/dev/null
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --out fresh.exr >/dev/null
near back.exr fresh.exr >/dev/null
