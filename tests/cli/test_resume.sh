# Stopped again and again, a sequence is complete in the end, and its cache is whole at every stop.
. "$ROOT/tests/cli/lib.sh"
args=("$SCENES/cornell.glb" --size 160x120 --spp 4 --preset draft --device embree --progress off
    --path "$SCENES/path.json" --frames 1-4 --out f.####.exr)
code=5
for ((n = 0; n < 40 && code != 0; ++n)); do
    code=0
    timeout --preserve-status --signal=INT 1 "$KEEPLIGHT" render "${args[@]}" --time-limit 0.5s >/dev/null 2>.why || code=$?
    [[ $code == 0 || $code == 3 || $code == 5 ]] || fail "exit code $code: $(<.why)"
    [[ ! -d cornell.klc ]] || [[ -z $(ls cornell.klc) ]] || kl cache check cornell.klc >/dev/null
done
kl render "${args[@]}" | head -n 1 | grep -q rendered || fail "not complete"
