# Ctrl-C leaves a state that the same command goes on from; a time limit does too.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/gallery.glb" --size 96x54 --spp 1 --preset draft --device embree --progress off
    --frames 1-3 --cache c.klc --out f.####.exr)
"$KEEPLIGHT" render "${args[@]}" --rays 65536 --cache first.klc >/dev/null &
pid=$!
sleep 1.5
kill -INT $pid
code=0
wait $pid || code=$?
[[ $code == 3 ]] || fail "exit code $code after an interrupt"
exits 5 kl render "${args[@]}" --rays 65536 --cache second.klc --time-limit 1s >/dev/null
kl render "${args[@]}" --rays 64
kl cache check c.klc >/dev/null
[[ -e f.0003.exr ]] || fail "not complete"
