# What renders have used is known, and prune drops the rest: pictures from the cache stay.
. "$ROOT/tests/cli/lib.sh"
flight=("$SCENES/gallery.glb" "${quick[@]}" --spp 32 --camera fly --cache c.klc)
exits 1 kl cache prune --unused none.klc 2>/dev/null
kl bake "${flight[@]}" --frames 1-25x12 >/dev/null
[[ $(kl cache info c.klc --json | grep '"use"') == *null* ]] || fail "a bake uses nothing"
exits 1 kl cache prune c.klc --unused 2>line
grep -q 'no render has told' line && [[ $(wc -l <line) == 1 ]] || fail "nobody has told"

# Any number of threads tells the same; the same again, frozen or not, is the same file.
cp -r c.klc d.klc
kl render "${flight[@]}" --frames 1 --out a.exr --threads 1 >/dev/null
kl render "${flight[@]}" --frames 1 --out d.exr --threads 2 --cache d.klc >/dev/null
same_tree c.klc d.klc
kl render "${flight[@]}" --frames 1 --out a.exr --overwrite --cache-mode freeze >/dev/null
same_tree c.klc d.klc
kl render "${flight[@]}" --frames 1 --out a.exr --overwrite --cache-mode freeze --threads 2 >/dev/null
same_tree c.klc d.klc
[[ $(ls c.klc/u-*.klu | wc -l) == 1 ]] || fail "one file of use"
kl cache info c.klc --json=info.json >/dev/null
seen=$(sed -n '/"levels"/,/]/s/.*"records": \([0-9]*\).*/\1/p' info.json | head -n 1)
used=$(sed -n '/"use"/,/}/s/.*"records": \([0-9]*\).*/\1/p' info.json)
((used > 0 && used < seen)) || fail "$used of $seen records used"
kl cache info c.klc | grep -q "^used  *$used of $seen seen records" || fail "info"
kl cache view c.klc "$SCENES/gallery.glb" --size 48x32 --rays 64 --error 0.06 --camera fly --by use --out view.exr >/dev/null
[[ $(ls c.klc/u-*.klu | wc -l) == 1 ]] || fail "looking is not using"

# Prune drops what was not used, and no more; the frame needs nothing anew.
cp -r c.klc e.klc
kl cache prune c.klc --unused --json=pruned.json >/dev/null
(($(value pruned.json dropped) == seen - used)) || fail "dropped $(value pruned.json dropped)"
kl cache check c.klc >/dev/null
kl render "${flight[@]}" --frames 1 --out b.exr --report b.json >/dev/null
(($(value b.json added) * 50 < used)) || fail "$(value b.json added) records were missed, $used used"
kl compare a.exr b.exr --json=diff.json >/dev/null
awk -v e="$(value diff.json relmse)" 'BEGIN { exit !(e < 0.01) }' || fail "another picture"

# By time: what was told lately counts, and what may be young stays.
kl cache prune e.klc --unused-for 1h | grep -q ' 0 records dropped' || fail "all may be young"
touch -d '2 hours ago' e.klc/*
exits 1 kl cache prune e.klc --unused-for 1h 2>line
kl render "${flight[@]}" --frames 1 --out f.exr --cache e.klc >/dev/null
kl cache prune e.klc --unused-for 1h --json=pruned.json >/dev/null
(($(value pruned.json dropped) == seen - used)) || fail "by time"

# A file that is damaged is ignored, with one line.
kl render "${flight[@]}" --frames 1 --out g.exr --cache d.klc --overwrite >/dev/null
printf 'XX' | dd of="$(ls d.klc/u-*.klu)" bs=1 seek=100 conv=notrunc status=none
kl cache info d.klc >/dev/null 2>line
grep -q 'warning.*ignored.*u-' line && [[ $(wc -l <line) == 1 ]] || fail "damage of use"
kl cache check d.klc >/dev/null
