# kl_room(NAME SOURCES ... LINK ...): one static library per room, with the warnings of docs/STYLE.md.

add_library(kl_flags INTERFACE)
target_include_directories(kl_flags INTERFACE ${PROJECT_SOURCE_DIR})
target_compile_definitions(kl_flags INTERFACE _POSIX_C_SOURCE=200809L)
target_compile_options(
  kl_flags
  INTERFACE -Wall
            -Wextra
            -Wpedantic
            -Wshadow
            -Wconversion
            -Wvla
            -Wswitch-enum
            -Wdouble-promotion
            -Wformat=2
            -Wcast-qual
            -Wundef
            -Wnull-dereference
            -ffp-contract=off
            -fno-math-errno
            -fno-trapping-math
            $<$<COMPILE_LANGUAGE:C>:-Wstrict-prototypes>
            $<$<COMPILE_LANGUAGE:C>:-Wmissing-prototypes>)
if(KL_WERROR)
  target_compile_options(kl_flags INTERFACE -Werror)
endif()
if(KL_NATIVE)
  target_compile_options(kl_flags INTERFACE -march=native)
endif()
if(KL_FUZZ) # the fuzzer is guided by what runs in the libraries too
  target_compile_options(kl_flags INTERFACE -fsanitize=fuzzer-no-link)
endif()
if(KL_SANITIZE)
  target_compile_options(kl_flags INTERFACE -fsanitize=${KL_SANITIZE} -fno-sanitize-recover=all
                                            -fno-omit-frame-pointer)
  target_link_options(kl_flags INTERFACE -fsanitize=${KL_SANITIZE})
endif()

function(kl_room name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_library(kl_${name} STATIC ${ARG_SOURCES})
  target_link_libraries(kl_${name} PUBLIC kl_flags ${ARG_LINK})
endfunction()
