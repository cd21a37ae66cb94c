#!/bin/bash
# scenes.sh KEEPLIGHT FOLDER: every scene file of $KEEPLIGHT_DATA/scenes. Valid ones render a small frame; broken ones are
# refused with one line and exit code 1, or render; none crashes or hangs. Exit code 77: there is no such data.
set -u -o pipefail
keeplight=$1 folder=$2
data=$(realpath -m "${KEEPLIGHT_DATA:-$(dirname "$0")/../../../shared}")/scenes
if [[ ! -d $data ]]; then
    echo "skipped: no scenes at $data (set KEEPLIGHT_DATA)"
    exit 77
fi
mkdir -p "$folder"
cd "$folder" || exit 1
quick=(--frames 1 --size 160x120 --spp 1 --cache-mode off --error 0.1 --rays 64 --device embree --aov none --overwrite --progress off)
failed=0

# try SCENE: exit code to $code, what went wrong to $errors (a count).
try() {
    rm -f frame.exr
    timeout 300 "$keeplight" render "$1" "${quick[@]}" --out frame.exr >out.txt 2>err.txt
    code=$?
    errors=$(grep -c '^keeplight: error: ' err.txt)
}

complain() {
    echo "FAILED: ${1#"$data"/}: $2"
    head -n 3 err.txt
    failed=1
}

while read -r scene; do
    try "$scene"
    case $scene in
    */unsupported-required/* | */broken/* | */nearly-valid/*)
        ((code == 0 || (code == 1 && errors == 1))) || complain "$scene" "exit code $code, $errors errors"
        ;;
    *)
        [[ $code == 0 && -s frame.exr ]] || complain "$scene" "exit code $code"
        ;;
    esac
    echo "$code ${scene#"$data"/} $(sed -n 's/^keeplight: //p' err.txt | head -n 1)"
done < <(find "$data" -name '*.gltf' -o -name '*.glb' | sort)
exit $failed
