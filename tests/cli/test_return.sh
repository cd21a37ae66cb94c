# What moved and is back finds the records of before; what moves out of sight changes none; an object
# that has turned once is where it was.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/changing-rooms.glb" --size 32x32 --spp 4 --preset draft --rays 64 --device embree --progress off
    --animation slide)
right=(--camera 'right camera')
left=(--camera 'left camera')
# The block is at rest until frame 12, away at 18, back at 24.
kl bake "${args[@]}" "${right[@]}" --frames 12 --cache before.klc >/dev/null
kl bake "${args[@]}" "${right[@]}" --frames 24 --cache back.klc >/dev/null
same_tree before.klc back.klc
kl bake "${args[@]}" "${right[@]}" --frames 18 --cache before.klc >/dev/null
kl bake "${args[@]}" "${right[@]}" --frames 24 --cache before.klc | grep -q ', 0 added' ||
    fail "the records of before are not found"
[[ $(find before.klc -name 't-*' | wc -l) == 2 ]] || fail "an instant that returns has a cache of its own"

for frame in 12 18; do
    kl bake "${args[@]}" "${left[@]}" --frames $frame --cache wall$frame.klc >/dev/null
done
kl cache diff wall12.klc/t-* wall18.klc/t-* --json=wall.json
[[ $(value wall.json same) == true && $(value wall.json both) != 0 ]] || fail "light came through the wall"

plate=("$SCENES/still-life.glb" "${quick[@]}" --turntable object:3 --cache plate.klc)
kl render "${plate[@]}" --frames 1-4 --out plate.####.exr >/dev/null
same_image plate.0001.exr plate.0004.exr >/dev/null
[[ $(find plate.klc -name 't-*' | wc -l) == 3 ]] || fail "the turn does not close"
