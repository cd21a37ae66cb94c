# Hard cases of whole runs: keys are seconds (36), four processes with one cache (38), no OpenCL (39).
. "$ROOT/tests/cli/lib.sh"
fast=("$SCENES/cornell-fast.glb" "${quick[@]}" --cache fast.klc)
kl render "${fast[@]}" --frames 3 --fps 24 --out a.exr --report a.json >/dev/null
kl render "${fast[@]}" --frames 6 --fps 48 --out b.exr --report b.json >/dev/null
[[ $(value a.json records_added) != 0 ]] || fail "36: nothing was gathered"
[[ $(value b.json records_added) == 0 ]] || fail "36: the same instant at another rate gathers anew"

processes=()
for i in 1 2 3 4; do
    kl render "$SCENES/cornell.glb" "${quick[@]}" --cache one.klc --seed "$i" --out "p$i.exr" >/dev/null &
    processes+=($!)
done
for process in "${processes[@]}"; do
    wait "$process" || fail "38: a process failed"
done
kl cache check one.klc >/dev/null || fail "38: the cache is damaged"
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache one.klc --out last.exr --report last.json >/dev/null
[[ $(value last.json records_added) == 0 ]] || fail "38: the cache is not full"

kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --out host.exr >/dev/null
OCL_ICD_VENDORS=/nowhere/ kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --device auto \
    --out auto.exr >/dev/null
same_image host.exr auto.exr >/dev/null
OCL_ICD_VENDORS=/nowhere/ exits 2 kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off \
    --device opencl --out no.exr 2>opencl.err
[[ $(wc -l <opencl.err) == 1 ]] || fail "39: one line"
