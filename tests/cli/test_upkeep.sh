# merge, prune, check --repair and info: what goes, what stays, and that the order of arguments does
# not matter.
. "$ROOT/tests/cli/lib.sh"
flight=("$SCENES/gallery.glb" "${quick[@]}" --camera fly)
kl bake "${flight[@]}" --frames 1-24x12 --cache a.klc >/dev/null
kl bake "${flight[@]}" --frames 25-48x12 --cache b.klc >/dev/null
kl bake "${flight[@]}" --frames 1-48x12 --cache whole.klc >/dev/null

# Either order gives the same bytes; a cache is not written over; strangers are refused.
kl cache merge a.klc b.klc -o ab.klc --json=merge.json >/dev/null
kl cache merge b.klc a.klc -o ba.klc >/dev/null
same_tree ab.klc ba.klc
kl cache check ab.klc >/dev/null
exits 1 kl cache merge a.klc b.klc -o ab.klc 2>/dev/null
kl bake "$SCENES/cornell.glb" "${quick[@]}" --cache other.klc >/dev/null
exits 4 kl cache merge a.klc other.klc -o x.klc 2>/dev/null
[[ ! -e x.klc ]] || fail "a merge that was refused left something behind"

# Frames of the merged cache are those of one bake, within the asked error (draft: 6 %).
kl render "${flight[@]}" --frames 20 --spp 16 --cache ab.klc --out merged.exr >/dev/null
kl render "${flight[@]}" --frames 20 --spp 16 --cache whole.klc --out whole.exr >/dev/null
kl compare merged.exr whole.exr --json=diff.json >/dev/null
awk -v e="$(value diff.json mean_error)" 'BEGIN { exit !(e > -0.06 && e < 0.06) }' || fail "mean error"
[[ $(value <(kl cache info ab.klc --json) segments) == 1 ]] || fail "the first run has indexed it"

# Two bad bytes: check names them, render goes on without that block, repair drops no more.
segment=$(cd whole.klc && ls *.kls)
kl cache info whole.klc --json=before.json
cp -r whole.klc bad.klc
printf 'XX' | dd of="bad.klc/$segment" bs=1 seek=40000 conv=notrunc status=none
exits 4 kl cache check bad.klc --json=bad.json >/dev/null 2>&1
[[ $(value bad.json blocks) == 1 && $(value bad.json segments) == 1 ]] || fail "one block is bad"
lost=$(value bad.json records)
cp -r bad.klc healed.klc
kl render "${flight[@]}" --frames 20 --cache healed.klc --out healed.exr >/dev/null 2>warning
grep -q 'warning.*cache check' warning || fail "no warning of damage"
kl cache check healed.klc >/dev/null
kl cache check bad.klc --repair >repair.txt
grep -q "$lost records lost" repair.txt || fail "what was lost is not said"
kl cache check bad.klc >/dev/null
kl cache info bad.klc --json=after.json
(($(value after.json records) == $(value before.json records) - lost)) || fail "more was lost"

# Prune.
half=$(($(value before.json bytes) / 2))
exits 1 kl cache prune whole.klc 2>/dev/null
kl cache prune whole.klc --max-bytes $half >/dev/null
(($(value <(kl cache info whole.klc --json) bytes) <= half)) || fail "prune --max-bytes"
kl cache prune a.klc --inside=-1000,-1000,-1000,1000,1000,1000 >/dev/null
[[ $(value <(kl cache info a.klc --json) records) == 0 ]] || fail "prune --inside"
kl cache prune b.klc --older-than 1000 | grep -q ' 0 records dropped' || fail "prune --older-than"
