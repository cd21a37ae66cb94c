# Progress is on stderr: JSON lines for farms; a default view where the scene has no camera.
. "$ROOT/tests/cli/lib.sh"
kl render "$SCENES/still-life.glb" "${quick[@]}" --out a.exr --progress json | head -n 1
