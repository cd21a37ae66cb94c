# cache dump, diff and view.
. "$ROOT/tests/cli/lib.sh"
kl bake "$SCENES/cornell.glb" "${quick[@]}" --cache c.klc >/dev/null
kl cache info c.klc --json=info.json
count=$(value info.json records)

kl cache dump c.klc -o out/c.csv --json=csv.json >/dev/null
[[ $(wc -l <out/c.csv) == $((count + 1)) && $(value csv.json records) == "$count" ]] || fail "csv"
# Positions lie in the box, normals are unit, radii positive, light not negative.
awk -F, 'NR > 1 {
    n = $6 * $6 + $7 * $7 + $8 * $8
    if ($3 < -1.001 || $3 > 1.001 || $4 < -0.001 || $4 > 2.001 || n < 0.999 || n > 1.001) exit 1
    if (!($9 > 0) || $10 < $9 || $11 < 0 || $14 < 0 || ($2 != 0 && $2 != 1)) exit 1
}' out/c.csv || fail "a row of the table"
kl cache dump c.klc -o c.ply >/dev/null
head -c 100 c.ply | grep -aq "element vertex $count" || fail "ply"
header=$(head -c 2000 c.ply | grep -abo end_header | cut -d: -f1)
[[ $(stat -c %s c.ply) == $((header + 11 + 68 * count)) ]] || fail "ply: its size"
kl cache dump c.klc -o c.vdb >/dev/null
[[ $(head -c 4 c.vdb) == " BDV" ]] || fail "vdb"
exits 1 kl cache dump c.klc -o c.txt
exits 1 kl cache dump c.klc
exits 1 kl cache dump nothing.klc -o c.csv

cp -r c.klc same.klc
kl cache diff c.klc same.klc --max-difference 0 --json=same.json >/dev/null
[[ $(value same.json same) == true && $(value same.json both) == "$count" ]] || fail "diff: same"
kl bake "$SCENES/cornell.glb" "${quick[@]}" --size 64x64 --cache more.klc >/dev/null
kl cache diff c.klc more.klc --json=more.json >/dev/null
kl cache diff more.klc c.klc --json=less.json >/dev/null
[[ $(value more.json only_b) -gt 0 && $(value more.json only_b) == $(value less.json only_a) &&
    $(value more.json both) == $(value less.json both) ]] || fail "diff: more"
exits 5 kl cache diff c.klc more.klc --max-difference 0.5 >/dev/null

for by in level age error late; do
    kl cache view c.klc "$SCENES/cornell.glb" --size 48x32 --spp 1 --rays 64 --error 0.06 --by $by \
        --out $by.exr --json=$by.json >/dev/null
    [[ -s $by.png && $(value $by.json drawn) -gt 100 ]] || fail "view $by"
    [[ $by == level ]] || ! cmp -s level.png $by.png || fail "view $by: as by level"
done
exits 1 kl cache view c.klc "$SCENES/cornell.glb" --by colour
exits 4 kl cache view c.klc "$SCENES/furnace.glb" --size 48x32 --rays 64 --out x.exr
