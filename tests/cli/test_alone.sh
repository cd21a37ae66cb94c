# Frame n alone, from a frozen cache, is frame n of the sequence.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell.glb" "${quick[@]}" --path "$SCENES/path.json" --cache c.klc)
kl bake "${args[@]}" --frames 1-4
kl render "${args[@]}" --frames 1-4 --out all.####.exr >/dev/null
kl render "${args[@]}" --frames 3 --out one.exr --cache-mode freeze >/dev/null
kl render "${args[@]}" --frames 4-1 --out back.####.exr --cache-mode load >/dev/null
same_image all.0003.exr one.exr >/dev/null
for frame in 1 2 3 4; do
    same_image all.000$frame.exr back.000$frame.exr >/dev/null
done
