// SPDX-License-Identifier: MIT
// The modular route's class Scene.
#include "pipedyn/modular/scene.hpp"

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

using Wholes = py::array_t<std::int64_t, py::array::c_style>;
/// (rows, columns, values)
using TripletArrays = py::typing::Tuple<Wholes, Wholes, Numbers>;

template <class T>
py::array_t<T, py::array::c_style> array_of(const std::vector<T>& values) {
  return py::array_t<T, py::array::c_style>(static_cast<py::ssize_t>(values.size()), values.data());
}

TripletArrays arrays_of(const Triplets& triplets) {
  return py::make_tuple(array_of(triplets.rows), array_of(triplets.columns),
                        array_of(triplets.values));
}

void require_columns(const char* name, const Matrix& rows, Index columns) {
  if (rows.cols() == columns) return;
  throw std::invalid_argument("a row of " + std::string(name) + " must have " +
                              std::to_string(columns) + " entries, got " +
                              std::to_string(rows.cols()));
}

/// springs: joint, stiffness, damping and rest angle; constraints: kind, node, x and y; inertia:
/// row, coordinate and weight of an entry, row after row.
Modules modules_of(Segments segments, const Matrix& springs, const Matrix& constraints,
                   const Matrix& inertia, bool flow, bool drag) {
  require_columns("springs", springs, 4);
  require_columns("constraints", constraints, 4);
  require_columns("inertia", inertia, 3);
  Modules made{.segments = std::move(segments), .flow = flow, .drag = drag};
  for (const auto& row : springs.rowwise()) {
    made.springs.emplace_back(static_cast<Index>(row[0]), row[1], row[2], row[3]);
  }
  for (const auto& row : constraints.rowwise()) {
    const auto kind = static_cast<Constraint::Kind>(static_cast<std::int64_t>(row[0]));
    made.constraints.push_back({kind, static_cast<Index>(row[1]), row[2], row[3]});
  }
  double last = -1.0;
  for (const auto& row : inertia.rowwise()) {
    if (row[0] != last) made.inertia.emplace_back();
    last = row[0];
    made.inertia.back().coordinate.push_back(static_cast<int>(row[1]));
    made.inertia.back().weight.push_back(row[2]);
  }
  return made;
}

/// Work of a scene's state, in that of a chain's segment.
py::ssize_t work_of(const Scene& scene) { return 30 * scene.segments(); }

Numbers scene_rhs(const Scene& scene, const py::object&, const py::object& y, const py::object& u,
                  const py::object& force) {
  if (force.is_none()) {
    return rates_of(2 * scene.coordinates(), work_of(scene), y, u,
                    [&](const Batch& batch, double* out) { scene.rhs(batch, nullptr, out); });
  }
  const States more("force", force, scene.coordinates());
  return rates_of(2 * scene.coordinates(), work_of(scene), y, u,
                  [&](const Batch& batch, double* out) {
                    if (batch.members != more.members) {
                      throw std::invalid_argument("force must have as many columns as y, got " +
                                                  std::to_string(more.members));
                    }
                    scene.rhs(batch, more.values.data(), out);
                  });
}

/// Of angles (n,) the states (6 n,), of (n, k) the states (6 n, k).
Numbers scene_from_angles(const Scene& scene, const py::object& theta, const py::object& omega) {
  const States angles("theta", theta, scene.segments());
  const States rates("omega", omega, scene.segments());
  if (angles.one != rates.one || angles.members != rates.members) {
    throw py::value_error("omega must have the shape of theta, got " + shape_of(rates.values));
  }
  using Columns = Eigen::Map<const Matrix>;
  const py::ssize_t rows = 2 * scene.coordinates();
  Numbers made = new_numbers(rows, angles.members, angles.one);
  const Columns of_angles(angles.values.data(), scene.segments(), angles.members);
  const Columns of_rates(rates.values.data(), scene.segments(), angles.members);
  Eigen::Map<Matrix>(made.mutable_data(), rows, angles.members) =
      scene.from_angles(of_angles, of_rates);
  return made;
}

template <class Work>
auto unlocked(const Work& work) {
  const py::gil_scoped_release released;
  return work();
}

py::typing::Tuple<TripletArrays, TripletArrays> pair_of(const Derivatives& derivatives) {
  return py::make_tuple(arrays_of(derivatives.by_coordinates), arrays_of(derivatives.by_rates));
}

}  // namespace

void define_scene(py::module_& m) {
  py::class_<Scene>(m, "Scene")
      .def(py::init([](const Pipe& pipe, Vector length, Vector center, Vector gyration_radius,
                       Vector drag_point, double base, const Matrix& springs,
                       const Matrix& constraints, const Matrix& inertia, bool flow, bool drag) {
             Segments segments{std::move(length), std::move(center),     std::move(gyration_radius),
                               Vector(),          std::move(drag_point), base};
             return std::make_unique<Scene>(
                 pipe, modules_of(std::move(segments), springs, constraints, inertia, flow, drag));
           }),
           "pipe"_a, "length"_a, "center"_a, "gyration_radius"_a, "drag_point"_a, "base"_a,
           "springs"_a, "constraints"_a, "inertia"_a, "flow"_a, "drag"_a)
      .def_property_readonly("coordinates", &Scene::coordinates)
      .def("straight", &Scene::straight, Unlocked())
      .def("operators",
           [](const Scene& scene) {
             const RedundantOperators ops = unlocked([&] { return scene.operators(); });
             py::typing::Dict<py::str, TripletArrays> made;
             made["mass"] = arrays_of(ops.mass);
             made["velocity"] = arrays_of(ops.velocity);
             made["flux"] = arrays_of(ops.flux);
             return made;
           })
      .def("forces", &Scene::forces, "y"_a, "u"_a, Unlocked())
      .def(
          "force_derivatives",
          [](const Scene& scene, const Vector& y, double u) {
            return pair_of(unlocked([&] { return scene.force_derivatives(y, u); }));
          },
          "y"_a, "u"_a)
      .def(
          "constraints",
          [](const Scene& scene,
             const Vector& y) -> py::typing::Tuple<Numbers, TripletArrays, Numbers, Wholes> {
            const ConstraintRows rows = unlocked([&] { return scene.constraints(y); });
            return py::make_tuple(rows.residual, arrays_of(rows.matrix), rows.right_side,
                                  array_of(rows.group));
          },
          "y"_a)
      .def(
          "hessians",
          [](const Scene& scene,
             const Vector& q) -> py::typing::Tuple<Wholes, Wholes, Wholes, Numbers> {
            const Hessians all = unlocked([&] { return scene.hessians(q); });
            return py::make_tuple(array_of(all.rows), array_of(all.entries.rows),
                                  array_of(all.entries.columns), array_of(all.entries.values));
          },
          "q"_a)
      .def("from_angles", scene_from_angles, "theta"_a, "omega"_a)
      .def(
          "project",
          [](const Scene& scene, Matrix theta, Matrix omega) {
            Vector missed = scene.project(theta, omega);
            return std::make_tuple(theta, omega, missed);
          },
          "theta"_a, "omega"_a, Unlocked())
      .def_readonly_static("met", &Scene::met)
      .def_readonly_static("return_rate", &Scene::return_rate)
      .def(
          "angle_rates",
          [](const Scene& scene, const py::object&, const py::object& y, const py::object& u) {
            return rates_of(
                2 * scene.segments() + 1, work_of(scene), y, u,
                [&](const Batch& batch, double* out) { scene.angle_rates(batch, out); });
          },
          "t"_a, "y"_a, "u"_a)
      .def("rhs", scene_rhs, "t"_a, "y"_a, "u"_a, "force"_a = py::none())
      .def(
          "energy",
          [](const Scene& scene, const py::object& y) {
            return energy_of(scene, 2 * scene.coordinates(), work_of(scene), y);
          },
          "y"_a)
      .def(
          "power",
          [](const Scene& scene, const py::object& y, const py::object& u) {
            return power_of(scene, 2 * scene.coordinates(), work_of(scene), y, u);
          },
          "y"_a, "u"_a)
      .def("lacking", &Scene::lacking, "q"_a, Unlocked());
}

}  // namespace pipedyn
