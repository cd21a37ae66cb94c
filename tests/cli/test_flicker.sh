# Temporal metrics of a short orbit: keys, order, reference, pictures, bad input.
. "$ROOT/tests/cli/lib.sh"
kl render "$SCENES/cornell.glb" "${quick[@]}" --turntable 72 --frames 8-12 --out 'a.%d.exr' >/dev/null
kl render "$SCENES/cornell.glb" "${quick[@]}" --turntable 72 --frames 8-12 --out 'r.####.exr' --seed 1 \
    --cache a.klc >/dev/null
kl flicker a.*.exr --json m.json | head -n 1 # 10 before 8, as the shell sorts
for key in layer frame_count flicker_mean flicker_p99 points followed pops block_steps; do
    [[ -n $(value m.json $key) ]] || fail "no $key"
done
for key in t_mse t_relmse lag_frames high_band_rms reference_flicker_mean; do
    [[ $(value m.json $key) == null ]] || fail "$key without a reference"
done
[[ $(grep -o '"frame": [0-9]*' m.json | tr -d '\n') == '"frame": 8"frame": 9"frame": 10"frame": 11"frame": 12' ]] ||
    fail "order"
kl flicker --json a.*.exr >stdout.json && cmp m.json stdout.json || fail "--json before the frames"
kl flicker a.*.exr --reference 'r.####.exr' --json pattern.json --heat h.png >/dev/null
kl flicker a.{8,9,10,11,12}.exr --reference r.*.exr --json=list.json --layer beauty >/dev/null
for file in pattern list; do
    [[ $(value $file.json t_relmse) != null && $(value $file.json high_band_rms) != null ]] ||
        fail "$file: no error against the reference"
done
[[ $(value list.json layer) == beauty && $(value pattern.json layer) == irradiance ]] || fail layer
[[ $(head -c 4 h.png | tail -c 3) == PNG ]] || fail "no heat map"
if command -v gnuplot >/dev/null; then
    kl flicker a.*.exr --plot p.svg >/dev/null
    grep -q '</svg>' p.svg || fail "no plot"
    exits 2 kl flicker a.*.exr --plot none/p.png >/dev/null 2>&1
fi
PATH=/nowhere exits 2 "$KEEPLIGHT" flicker a.8.exr a.9.exr --plot q.svg >/dev/null

kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --aov none --frames 1-2 --out bare.####.exr >/dev/null
exits 1 kl flicker a.8.exr
exits 1 kl flicker a.8.exr missing.exr
exits 1 kl flicker a.8.exr a.10.exr
exits 1 kl flicker a.8.exr "$SCENES/sky.exr"
exits 1 kl flicker bare.*.exr
exits 1 kl flicker a.8.exr a.9.exr --layer shadow
exits 1 kl flicker a.8.exr a.9.exr --plot p.pdf
exits 1 kl flicker a.8.exr a.9.exr --reference r.0008.exr
exits 1 kl flicker a.8.exr a.9.exr --reference r.0009.exr r.0008.exr
