# What was understood of a scene, as text and as JSON.
. "$ROOT/tests/cli/lib.sh"
cd "$SCENES"
kl scene cornell.glb
kl scene cornell-fast.glb --json >"$OLDPWD/a.json"
kl scene cornell-fast.glb --json="$OLDPWD/b.json" >/dev/null
cd "$OLDPWD"
cmp a.json b.json
[[ $(value a.json triangles) == 38 && $(value a.json moving) == true ]] || fail "JSON"
[[ $(value a.json rigid) == 2 && $(value a.json deforming) == 0 &&
  $(value a.json steps) -ge 2 ]] || fail "motion"
kl scene "$SCENES/cornell.glb" --env "$SCENES/sky.exr" | grep -q '^sky  *128x64$' || fail "sky"
