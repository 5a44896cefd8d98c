"""glTF 2.0: animated, skinned and morphed meshes of .glb and .gltf files."""
