# --verify extends the cache until the error is met, says what it measured, and ends with 5 where it cannot be met.
. "$ROOT/tests/cli/lib.sh"
options=(--spp 1 --aov none --rays 64 --cache-mode off --overwrite --device embree --progress off)
kl render "$SCENES/cornell.glb" "${options[@]}" --size 32x32 --error 0.1 --verify 10% --out a.exr --report a.json >a.txt
grep -q "^irradiance at .* pixels: bias .* 95 % within " a.txt || fail "no line about the irradiance"
below() {
    awk -v a="$1" -v b="$2" 'BEGIN { exit !(a > 0 && a <= b) }' || fail "$1 is not in (0, $2]"
}
below "$(value a.json measured_error)" 0.085
below "$(value a.json p95)" 0.12
below "$(value a.json reference_noise)" 0.04
# Pixels as large as what lies on the table: radii cannot get small enough.
exits 5 kl render "$SCENES/still-life.glb" "${options[@]}" --size 8x6 --error 0.03 --verify 50% --out b.exr --report b.json >/dev/null 2>b.err
grep -q "95 % of the irradiance is within 0.*, not within the --error 0.03" b.err || fail "not said that the error was not met"
[[ -s b.exr ]] || fail "no frame"
grep -q "\"outcome\": \"limit\"" b.json || fail "not a limit"
