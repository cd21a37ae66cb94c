# A moving scene keeps one store per instant; a second run adds nothing; a frame alone is the same.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell-fast.glb" "${quick[@]}" --cache c.klc)
kl render "${args[@]}" --frames 1-3 --out a.####.exr | head -n 1
kl cache info c.klc | grep '^instants'
kl render "${args[@]}" --frames 1-3 --out b.####.exr --report b.json >/dev/null
[[ $(value b.json records_added) == 0 ]] || fail "the warm run added records"
kl render "${args[@]}" --frames 2 --out one.exr --cache-mode freeze >/dev/null
same_image a.0002.exr one.exr >/dev/null
same_image a.0002.exr b.0002.exr >/dev/null
kl render "${args[@]}" --frames 1-3 --out a.####.exr | head -n 1
kl cache check c.klc | wc -l
