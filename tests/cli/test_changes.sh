# Lights and materials that change by KHR_animation_pointer: an instant of the animation is the scene
# that was edited to look like it, bit for bit; after a step the light is there in the same frame.
. "$ROOT/tests/cli/lib.sh"
scene=$SCENES/changing-rooms.glb
args=(--size 32x32 --spp 4 --preset draft --rays 64 --device embree --progress off)

# edited ANIMATION CAMERA EDIT...: frame 6 of the animation is that of the edited scene at rest.
edited() {
    local animation=$1 camera="$2 camera"
    shift 2
    python3 "$ROOT/tests/data/edit_scene.py" "$scene" edited.glb "$@"
    kl render edited.glb "${args[@]}" --animation slide --frames 6 --camera "$camera" --cache-mode off \
        --out "$animation.edited.exr" >/dev/null
    kl render "$scene" "${args[@]}" --animation "$animation" --frames 6 --camera "$camera" --cache-mode off \
        --out "$animation.exr" >/dev/null
    same_image "$animation.edited.exr" "$animation.exr" >/dev/null
}
edited dim left light point 0.25
edited step right emission panel 0.25
edited paint right color clay 0.5 0.25 0.125

# The panel steps down at frame 6; nothing of the light of before is served there.
sequence=("$scene" --animation step --camera 'right camera')
kl render "${sequence[@]}" "${args[@]}" --frames 1-10 --cache c.klc --out s.####.exr >/dev/null
[[ $(find c.klc -name 't-*' | wc -l) == 2 ]] || fail "frames that look alike share a cache"
for frame in 5 6; do
    kl render "${sequence[@]}" "${args[@]}" --frames $frame --cache-mode off --out fresh$frame.exr >/dev/null
    same_image s.000$frame.exr fresh$frame.exr >/dev/null
done
kl render "${sequence[@]}" "${args[@]}" --frames 1-10 --indirect path --spp 32 --out r.####.exr >/dev/null
kl flicker s.*.exr --reference 'r.####.exr' --json=m.json >/dev/null
awk -v lag="$(value m.json lag_frames)" -v fit="$(value m.json lag_correlation)" \
    'BEGIN { exit !(lag >= -0.5 && lag <= 0.5 && fit > 0.9) }' || fail "the light is late"
