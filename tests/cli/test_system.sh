# What the system refuses: exit code 2.
. "$ROOT/tests/cli/lib.sh"
touch file
exits 2 kl render "$SCENES/cornell.glb" "${quick[@]}" --out file/x.exr
