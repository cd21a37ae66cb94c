# The shutter's curve: where its weights lie in time is where the blurred image looks like.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell-fast.glb" --size 48x48 --spp 64 --indirect off --aov none --progress off --frames 2)
blurred() {
    kl render "${args[@]}" --shutter 360 "${@:2}" --out "$1.exr" >/dev/null
}
blurred plain
blurred box --shutter-curve box
same_image plain.exr box.exr >/dev/null
blurred early --shutter-curve 1,0,0,0
blurred late --shutter-curve 0,0,0,1
blurred middle --shutter-curve triangle
blurred cosine --shutter-curve cosine
for at in -0.5 0 0.5; do # still images at opening, centre and closing
    kl render "${args[@]}" --shutter-offset=${at}f --out "still$at.exr" >/dev/null
done
# closer TO.exr A.exr B.exr: A is nearer to it than B.
closer() {
    kl compare "$2" "$1" --json=a.json
    kl compare "$3" "$1" --json=b.json
    awk -v a="$(value a.json rmse)" -v b="$(value b.json rmse)" 'BEGIN { exit !(a < b) }' ||
        fail "$2 should be nearer to $1 than $3"
}
closer still-0.5.exr early.exr late.exr
closer still0.5.exr late.exr early.exr
for curve in middle cosine; do # more time in the middle than with a box
    closer still0.exr $curve.exr plain.exr
done
exits 1 kl render "${args[@]}" --shutter-curve wave
exits 1 kl render "${args[@]}" --shutter-curve 0,0
exits 1 kl render "${args[@]}" --shutter-curve 1
exits 1 kl render "${args[@]}" --shutter-curve 1,-1
