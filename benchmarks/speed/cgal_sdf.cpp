// Times CGAL's shape diameter function on a mesh, and nothing but it.
//
// Usage: cgal_sdf MESH.off RAYS CONE_DEGREES SMOOTH VALUES.txt
// Prints the seconds taken by sdf_values, wall clock and CPU, without reading the mesh. The kernel is the one of the
// manual's examples. SMOOTH is 1 for CGAL's default, which smooths and normalises the values
// afterwards, and 0 for rays alone.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/IO/OFF.h>
#include <CGAL/mesh_segmentation.h>

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <string>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Face = boost::graph_traits<Mesh>::face_descriptor;

int main(int argc, char** argv) {
  if (argc != 6) {
    std::cerr << "usage: cgal_sdf MESH.off RAYS CONE_DEGREES SMOOTH VALUES.txt\n";
    return 2;
  }
  const std::size_t rays = std::strtoul(argv[2], nullptr, 10);
  const double cone = std::atof(argv[3]) * CGAL_PI / 180.0;
  const bool smooth = std::string(argv[4]) == "1";
  Mesh mesh;
  if (!CGAL::IO::read_OFF(argv[1], mesh) || !CGAL::is_triangle_mesh(mesh)) {
    std::cerr << "cgal_sdf: " << argv[1] << " is not a manifold triangle mesh\n";
    return 3;
  }
  auto values = mesh.add_property_map<Face, double>("f:sdf", 0.0).first;

  const auto start = std::chrono::steady_clock::now();
  const std::clock_t cpu = std::clock();
  CGAL::sdf_values(mesh, values, cone, rays, smooth);
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
  const double busy = double(std::clock() - cpu) / CLOCKS_PER_SEC;

  std::cout.precision(9);
  std::cout << taken.count() << " " << busy << "\n";
  std::ofstream out(argv[5]);
  out.precision(9);
  for (const Face face : faces(mesh)) out << values[face] << "\n";
  return out ? 0 : 4;
}
