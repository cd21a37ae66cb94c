# Metrics of equal and of different pictures; JSON has the promised keys.
. "$ROOT/tests/cli/lib.sh"
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --out a.exr >/dev/null
kl render "$SCENES/cornell.glb" "${quick[@]}" --cache-mode off --seed 1 --out b.exr >/dev/null
same_image a.exr a.exr >/dev/null
kl compare a.exr b.exr --json m.json --diff d.png --mask-above 5 | head -n 1
for key in relmse rmse psnr_db smape mean_error flip_mean max_abs width height block8_relmse; do
    [[ -n $(value m.json $key) ]] || fail "no $key"
done
[[ $(value m.json masked_pixels) != 0 ]] || fail "mask"
[[ $(value m.json max_abs) != 0.0 ]] || fail "seeds make no difference"
[[ $(head -c 4 d.png | tail -c 3) == PNG ]] || fail "no picture"
kl compare a.exr b.exr --layer irradiance --json=e.json
[[ $(value e.json relative_p95) != "$(value m.json relative_p95)" ]] || fail "layer"
exits 1 kl compare a.exr b.exr --layer shadow
exits 1 kl compare a.exr "$SCENES/sky.exr"
