#!/bin/bash
# kill_bake.sh KEEPLIGHT SCENE FOLDER KILLS: a bake is killed at KILLS random moments, its publication
# of the base among them. After each kill the store is whole and has lost no record; in the end its
# frame is that of a bake that nobody disturbed, within the asked error (draft: 6 %).
set -eu -o pipefail
keeplight=$1 scene=$2 folder=$3 kills=$4
rm -rf "$folder"
mkdir -p "$folder"
cd "$folder"
RANDOM=1
bake=(--size 64x48 --spp 1 --preset draft --rays 64 --device embree --progress off --threads 1)

value() {
    sed -n 's/^ *"'"$2"'": "\{0,1\}\([^",]*\)"\{0,1\},\{0,1\}$/\1/p' "$1" | head -n 1
}
start=$(date +%s%N)
"$keeplight" bake "$scene" "${bake[@]}" --cache quiet.klc >/dev/null
length=$((($(date +%s%N) - start) / 1000000)) # [ms]

done_bakes=0
killed=0
records=0
while ((killed < kills)); do
    "$keeplight" bake "$scene" "${bake[@]}" --cache c.klc >/dev/null 2>&1 &
    pid=$!
    sleep "$(awk -v r=$RANDOM -v l="$length" 'BEGIN { print r / 32768 * l * 1.1 / 1000 }')"
    kill -9 $pid 2>/dev/null || true
    wait $pid 2>/dev/null && finished=1 || finished=0
    if ! ls c.klc/*.kls >/dev/null 2>&1; then
        killed=$((killed + 1 - finished))
        continue
    fi
    "$keeplight" cache check c.klc >/dev/null || { echo "FAILED: damaged"; exit 1; }
    "$keeplight" cache info c.klc --json=info.json >/dev/null
    now=$(value info.json records)
    ((now >= records)) || { echo "FAILED: $records records, then $now"; exit 1; }
    records=$now
    killed=$((killed + 1 - finished))
    if ((finished)); then # the next one begins anew
        done_bakes=$((done_bakes + 1))
        rm -rf last.klc
        mv c.klc last.klc
        records=0
    fi
done
[[ -e last.klc ]] && rm -rf c.klc && mv last.klc c.klc # that of the last bake that had been killed
"$keeplight" bake "$scene" "${bake[@]}" --cache c.klc >/dev/null
for cache in quiet c; do
    "$keeplight" render "$scene" "${bake[@]}" --spp 16 --cache $cache.klc --out $cache.exr >/dev/null
done
"$keeplight" compare c.exr quiet.exr --json=compare.json >/dev/null
error=$(value compare.json mean_error)
echo "$killed kills, $done_bakes bakes ended between them, mean error $error, relMSE $(value compare.json relmse)"
awk -v e="$error" 'BEGIN { exit !(e > -0.06 && e < 0.06) }' || { echo "FAILED: image"; exit 1; }
