# Bad command lines: exit code 1 and one line that names the option.
. "$ROOT/tests/cli/lib.sh"
exits 1 kl frob
exits 1 kl cache
exits 1 kl render
exits 1 kl render a.glb b.glb
exits 1 kl render "$SCENES/cornell.glb" --bogus
exits 1 kl render "$SCENES/cornell.glb" --spp
exits 1 kl render "$SCENES/cornell.glb" --spp none
exits 1 kl render "$SCENES/cornell.glb" --size 10
exits 1 kl render "$SCENES/cornell.glb" --frames 1-x
exits 1 kl render "$SCENES/cornell.glb" --cache-mode sometimes
exits 1 kl render "$SCENES/cornell.glb" --preset lovely
exits 1 kl render "$SCENES/cornell.glb" --turntable 8 --path "$SCENES/path.json"
exits 1 kl render "$SCENES/cornell.glb" --camera nobody
exits 1 kl render "$SCENES/cornell.glb" --animation nothing
exits 1 kl render "$SCENES/cornell.glb" --aov colour
exits 1 kl bake "$SCENES/cornell.glb" --indirect path
exits 1 kl bake "$SCENES/cornell.glb" --cache-mode freeze
exits 1 kl compare one.exr
