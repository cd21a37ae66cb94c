# Files that are not there or not what they should be: exit code 1, the file is named.
. "$ROOT/tests/cli/lib.sh"
exits 1 kl render none.glb
exits 1 kl render "$SCENES/broken.glb"
exits 1 kl render "$SCENES/cornell.glb" --env none.exr
exits 1 kl render "$SCENES/cornell.glb" --env "$SCENES/cornell.glb"
exits 1 kl render "$SCENES/cornell.glb" --path none.json
exits 1 kl render "$SCENES/cornell.glb" --cache none.klc --cache-mode freeze
exits 1 kl cache info none.klc
exits 1 kl cache check none.klc
exits 1 kl compare none.exr "$SCENES/sky.exr"
exits 1 kl compare "$SCENES/cornell.glb" "$SCENES/sky.exr"
[[ ! -e none.klc ]] || fail "a frozen cache was created"
