# Caches of the frames around, blended: steadier light from few rays, and nothing else changes.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell-fast.glb" --size 32x32 --spp 4 --error 0.5 --rays 16 --device embree --progress off)
kl render "${args[@]}" --frames 3-10 --cache plain.klc --out plain.####.exr >/dev/null
kl render "${args[@]}" --frames 3-10 --cache blend.klc --out blend.####.exr --cache-blend 2 \
    --report blend.json >/dev/null
[[ $(value blend.json cache_blend) == 2 ]] || fail "not in the report"
for name in plain blend; do
    kl flicker $name.*.exr --json=$name.json >/dev/null
done
awk -v a="$(value blend.json flicker_mean)" -v b="$(value plain.json flicker_mean)" \
    'BEGIN { exit !(a < 0.9 * b) }' || fail "blending does not steady the light"

# Two more frames are filled at either end, each for itself: the others are as without blending.
[[ $(find plain.klc -name 't-*' | wc -l) == 8 ]] || fail "a cache for each frame"
[[ $(find blend.klc -name 't-*' | wc -l) == 12 ]] || fail "the range is not padded"
for store in plain.klc/*; do
    for segment in "$store"/*.kls; do
        cmp "$segment" "blend.klc/${segment#*/}" || fail "blending fills otherwise"
    done
done
kl bake "${args[@]}" --frames 6 --cache baked.klc --cache-blend 2 >/dev/null
[[ $(find baked.klc -name 't-*' | wc -l) == 5 ]] || fail "bake does not pad"

# A frame alone, from caches that were baked for it; any number of threads; no file of other settings.
kl render "${args[@]}" --frames 6 --cache baked.klc --cache-blend 2 --cache-mode freeze --out one.exr >/dev/null
same_image one.exr blend.0006.exr >/dev/null
for n in 1 2; do
    kl render "${args[@]}" --frames 6 --cache $n.klc --cache-blend 2 --threads $n --out $n.exr >/dev/null
    same_image $n.exr blend.0006.exr >/dev/null
done
same_tree 1.klc 2.klc
exits 1 kl render "${args[@]}" --frames 3-10 --cache blend.klc --out blend.####.exr
exits 4 kl render "${args[@]}" --frames 6 --cache plain.klc --cache-blend 4 --cache-mode freeze --out x.exr

# None is none, and so it is where only cameras move.
kl render "${args[@]}" --frames 6 --cache none.klc --out none.exr --cache-blend 0 >/dev/null
kl render "${args[@]}" --frames 6 --cache none.klc --out none.exr | head -n 1
same_image none.exr plain.0006.exr >/dev/null
for n in 0 2; do
    kl render "$SCENES/cornell.glb" "${args[@]:1}" --cache still$n.klc --out still$n.exr --cache-blend $n >/dev/null
done
same_tree still0.klc still2.klc
same_image still0.exr still2.exr >/dev/null
exits 1 kl render "${args[@]}" --cache-blend 9
exits 1 kl render "${args[@]}" --cache-blend -1
