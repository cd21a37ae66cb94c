# What each room may include: docs/ARCHITECTURE.md. Private headers stay in their folder, and some
# functions are not used at all.
cd "$ROOT"

# room FOLDER 'ALLOWED...': no file of FOLDER includes another room, nor a library that is not named.
room() {
    local folder=$1 allowed
    allowed=$(printf '|%s' $2)
    grep -EHno '^ *# *include *"[^"]*/' "$folder"/*.[ch] "$folder"/*.[ch]pp 2>/dev/null |
        grep -Ev "\"($folder$allowed)/\$" || true
    for library in $libraries; do
        [[ " $2 " == *" $library "* ]] && continue
        grep -EHn "^ *# *include *<$library" "$folder"/*.[ch] "$folder"/*.[ch]pp 2>/dev/null || true
    done
}
libraries='openvdb embree3 CL/ openexr OpenEXR jansson png.h tiny_gltf popt xxhash omp.h'

room kernels ''
room src/base 'xxhash'
room src/scene 'src/base kernels'
room src/import 'src/base src/scene kernels tiny_gltf openexr OpenEXR openvdb'
room src/trace 'src/base src/scene kernels embree3 omp.h'
room src/device 'src/base src/scene src/trace kernels CL/ omp.h'
room src/cache 'src/base kernels omp.h'
room src/image 'src/base openexr png.h omp.h'
room cache_io 'src/base kernels'
room sequences 'src/base jansson'
room src/render 'src/base src/scene src/trace src/device src/cache src/image cache_io kernels omp.h'

for header in $(git ls-files '*_impl.h' '*_impl.hpp'); do
    folder=$(dirname "$header")
    grep -EHn "^ *# *include.*\"$header\"" -r src kernels cache_io sequences --include='*.[ch]' \
        --include='*.[ch]pp' | grep -v "^$folder/" || true
done
banned='sprintf|strtok|atoi|atof|rand|strerror|alloca|setjmp|gets|strcpy|strcat'
grep -EHn "(^|[^_[:alnum:]])($banned)\\(" -r src cache_io sequences kernels --include='*.[ch]' \
    --include='*.[ch]pp' || true
# File names are unique, but for what folders name themselves.
git ls-files src kernels cache_io sequences | xargs basename -a |
    grep -v CMakeLists.txt | sort | uniq -d | grep -v '^gather.h$' || true
