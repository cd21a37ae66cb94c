# A frame that is there with its fingerprint is skipped, another one is refused, unless told.
. "$ROOT/tests/cli/lib.sh"
render() { kl render "$SCENES/cornell.glb" "${quick[@]}" --out f.####.exr --frames 1-3 "$@"; }
render | head -n 1
stamp=$(stat -c %Y.%i f.0002.exr)
rm f.0003.exr
render --resume | head -n 1
[[ $(stat -c %Y.%i f.0002.exr) == "$stamp" ]] || fail "a finished frame was written again"
exits 1 render --spp 3
head -c 2000 f.0001.exr >cut && mv cut f.0001.exr
render | head -n 1
render --overwrite | head -n 1
[[ $(stat -c %Y.%i f.0002.exr) != "$stamp" ]] || fail "--overwrite did not"
