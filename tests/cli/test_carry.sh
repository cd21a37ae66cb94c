# Records that are carried from frame to frame: what cannot have changed costs no ray, what moved and
# is back is lit as before, light is followed with a third of the rays, and threads change nothing.
. "$ROOT/tests/cli/lib.sh"
scene=("$SCENES/changing-rooms.glb" --animation slide --size 32x32 --spp 4 --error 0.06 --rays 64 --device embree
    --progress off --cache-mode off)
right=(--camera 'right camera')

# rays FILE FIRST: gather rays of each frame of a report, from the FIRST of its frames on.
rays() {
    sed -n 's/^ *"gather": \([0-9]*\),\{0,1\}$/\1/p' "$1" | sed '$d' | tail -n +"$2"
}
sum() {
    awk '{ s += $1 } END { print s + 0 }'
}

# The block, at rest until frame 12, moves behind the wall.
kl render "${scene[@]}" --camera 'left camera' --frames 12-16 --moving carry --report wall.json --out wall.####.exr >/dev/null
[[ $(value wall.json moving) == carry ]] || fail "not in the report"
[[ $(rays wall.json 1 | wc -l) == 5 ]] || fail "not a number a frame"
[[ $(rays wall.json 2 | sum) == 0 ]] || fail "rays were shot for what moved behind a wall"

# It is away at 18 and back at 24; at 34 every ray has had its turn since.
kl render "${scene[@]}" "${right[@]}" --frames 12-34 --moving carry --report carry.json --out carry.####.exr >/dev/null
kl render "${scene[@]}" "${right[@]}" --frames 12,18,34 --report anew.json --out anew.####.exr >/dev/null
kl render "${scene[@]}" "${right[@]}" --frames 18,34 --indirect path --spp 256 --out path.####.exr >/dev/null
same_image carry.0012.exr anew.0012.exr >/dev/null
rays carry.json 2 | head -n 12 | sum >moving.txt
awk -v carried="$(cat moving.txt)" -v anew="$(rays anew.json 2 | head -n 1)" \
    'BEGIN { exit !(carried > 0 && carried < 0.35 * 12 * anew) }' || fail "too many rays: $(cat moving.txt)"

# error NAME FRAME: of the indirect light.
error() {
    kl compare "$1.$2.exr" "path.$2.exr" --layer diffuse_indirect --json=error.json >/dev/null
    value error.json relmse
}
for frame in 0018 0034; do
    awk -v carried="$(error carry $frame)" -v anew="$(error anew $frame)" \
        'BEGIN { exit !(carried < 1.25 * anew) }' || fail "frame $frame: carried light is worse"
done

# Any number of threads; stores on disk, which other runs read; where nothing moves it is nothing.
for n in 1 3; do
    kl render "${scene[@]:0:11}" "${right[@]}" --progress off --frames 12-14 --moving carry --threads $n --cache $n.klc \
        --out $n.####.exr >/dev/null
done
same_tree 1.klc 3.klc
same_image 1.0014.exr 3.0014.exr >/dev/null
same_image 1.0014.exr carry.0014.exr >/dev/null
kl render "${scene[@]:0:11}" "${right[@]}" --progress off --frames 14 --cache 1.klc --cache-mode freeze --out frozen.exr >/dev/null
same_image frozen.exr carry.0014.exr >/dev/null
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --out still.exr >/dev/null
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --out still.exr --moving carry | head -n 1

exits 1 kl render "${scene[@]}" --moving carry --cache-blend 1

# A device shoots the same rays.
kl render "${scene[@]}" "${right[@]}" --frames 12-14 --moving carry --report host.json --out host.####.exr >/dev/null
code=0
kl render "${scene[@]}" "${right[@]}" --frames 12-14 --moving carry --device opencl --report device.json --out device.####.exr \
    >/dev/null 2>&1 || code=$?
if [[ $code == 2 ]]; then
    echo "SKIPPED: no OpenCL device" >skipped.txt
else
    kl compare device.0014.exr host.0014.exr --layer diffuse_indirect --json=device.cmp >/dev/null
    awk -v error="$(value device.cmp relmse)" -v a="$(rays device.json 2 | sum)" -v b="$(rays host.json 2 | sum)" \
        'BEGIN { exit !(error < 1e-5 && a > 0.99 * b && a < 1.01 * b) }' || fail "the device differs"
fi
exits 1 kl render "${scene[@]}" --moving along
