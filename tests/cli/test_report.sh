# The report has the keys that tools rely on.
. "$ROOT/tests/cli/lib.sh"
kl render "$SCENES/cornell.glb" "${quick[@]}" --aov Z,N --out a.exr --png --report r.json >/dev/null
for key in version commit device threads path digest triangles lights needs fps frame file total \
    visibility fill gather insert shade write loaded added refreshed late lookups lookup_hits \
    reused_last primary shadow uncovered error_estimate seconds records cache_bytes peak_rss_bytes; do
    grep -q "\"$key\":" r.json || fail "no $key"
done
[[ $(value r.json error_estimate) == 0.* ]] || fail "no error estimate"
[[ $(head -c 4 a.png | tail -c 3) == PNG ]] || fail "no preview"
kl sheet s.png a.exr a.exr a.exr --columns 2 --reduce 2 --exposure 1

# No pixel of 16 384 is left without records, or with records on one side alone (decision 0035).
kl render "$SCENES/cornell.glb" --frames 1 --size 128x128 --spp 1 --error 0.1 --rays 256 --device embree \
    --cache-mode off --aov none --out b.exr --report b.json >/dev/null
[[ $(value b.json uncovered) =~ ^0(\.0*)?$ ]] || fail "$(value b.json uncovered) of the pixels are left"
