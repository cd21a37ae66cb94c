kl_fuzz(fuzz_gltf SOURCES fuzz_gltf.cpp LINK kl_import)
