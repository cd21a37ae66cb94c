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
