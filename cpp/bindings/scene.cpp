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

using Whole = Eigen::Matrix<std::int64_t, Eigen::Dynamic, 1>;
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

/// Items that lie in arrays of equal length, one for each of their parts.
template <class Item, class... Parts>
std::vector<Item> items(const char* what, const Whole& first, const Parts&... parts) {
  std::vector<Item> made;
  if (((parts.size() != first.size()) || ...)) {
    throw std::invalid_argument(std::string(what) + " must have arrays of equal length");
  }
  made.reserve(static_cast<std::size_t>(first.size()));
  for (Index i = 0; i < first.size(); ++i) made.push_back(Item{first[i], parts[i]...});
  return made;
}

std::vector<Constraint> constraints_of(const Whole& kind, const Whole& node, const Vector& x,
                                       const Vector& y) {
  struct Given {
    std::int64_t kind;
    Index node;
    double x, y;
  };
  std::vector<Constraint> made;
  for (const Given& given : items<Given>("constraints", kind, node, x, y)) {
    made.push_back({static_cast<Constraint::Kind>(given.kind), given.node, given.x, given.y});
  }
  return made;
}

/// Rows in order, each with the entries that have its number.
std::vector<InertiaRow> inertia_of(const Whole& row, const Whole& coordinate,
                                   const Vector& weight) {
  struct Entry {
    std::int64_t row, coordinate;
    double weight;
  };
  std::vector<InertiaRow> made;
  std::int64_t last = -1;
  for (const Entry& entry : items<Entry>("inertia", row, coordinate, weight)) {
    if (made.empty() || entry.row != last) made.emplace_back();
    last = entry.row;
    made.back().coordinate.push_back(static_cast<int>(entry.coordinate));
    made.back().weight.push_back(entry.weight);
  }
  return made;
}

/// Work of a scene's segment, in that of a chain's.
constexpr py::ssize_t enforcement_work = 30;

Numbers scene_rhs(const Scene& scene, const py::object&, const py::object& y, const py::object& u,
                  const py::object& force) {
  const py::ssize_t rows = 2 * scene.coordinates();
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  std::optional<States> forces;
  if (!force.is_none()) {
    forces.emplace("force", force, scene.coordinates());
    if (forces->one != states.one || forces->members != states.members) {
      throw py::value_error("force must have as many columns as y, got " +
                            shape_of(forces->values));
    }
  }
  Numbers rates = new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  const double* const more = forces ? forces->values.data() : nullptr;
  double* const out = rates.mutable_data();
  run(enforcement_work * scene.segments() * states.members, [&] { scene.rhs(batch, more, out); });
  return rates;
}

Numbers scene_angle_rates(const Scene& scene, const py::object&, const py::object& y,
                          const py::object& u) {
  const py::ssize_t rows = 2 * scene.segments() + 1;
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  Numbers rates = new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  double* const out = rates.mutable_data();
  run(enforcement_work * scene.segments() * states.members, [&] { scene.angle_rates(batch, out); });
  return rates;
}

NumberOrArray scene_energy(const Scene& scene, const py::object& y) {
  const States states("y", y, 2 * scene.coordinates());
  const double still = 0.0;
  const Batch batch{states.values.data(), &still, states.members, 0};
  Numbers result(states.members);
  double* const out = result.mutable_data();
  run(scene.segments() * states.members, [&] { scene.energy(batch, out); });
  return number_or_array(result, states.one);
}

/// (flow, joints, drag, others)
using SceneParts = py::typing::Tuple<NumberOrArray, NumberOrArray, NumberOrArray, NumberOrArray>;

SceneParts scene_power(const Scene& scene, const py::object& y, const py::object& u) {
  const States states("y", y, 2 * scene.coordinates());
  const Speeds speeds("u", u, states);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  Numbers flow(states.members), joints(states.members), drag(states.members),
      others(states.members);
  const PowerParts parts{flow.mutable_data(), joints.mutable_data(), drag.mutable_data(),
                         others.mutable_data()};
  run(scene.segments() * states.members, [&] { scene.power(batch, parts); });
  return py::make_tuple(number_or_array(flow, states.one), number_or_array(joints, states.one),
                        number_or_array(drag, states.one), number_or_array(others, states.one));
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
      .def(
          py::init([](const Pipe& pipe, Vector length, Vector center, Vector gyration_radius,
                      Vector drag_point, double base, const Whole& spring_joint,
                      const Vector& spring_stiffness, const Vector& spring_damping,
                      const Vector& spring_rest, bool flow, bool drag, const Whole& constraint_kind,
                      const Whole& constraint_node, const Vector& constraint_x,
                      const Vector& constraint_y, const Whole& inertia_row,
                      const Whole& inertia_coordinate, const Vector& inertia_weight) {
            return std::make_unique<Scene>(
                pipe,
                Modules{
                    .segments = {std::move(length), std::move(center), std::move(gyration_radius),
                                 Vector(), std::move(drag_point), base},
                    .springs = items<TorsionalSpring>("springs", spring_joint, spring_stiffness,
                                                      spring_damping, spring_rest),
                    .constraints = constraints_of(constraint_kind, constraint_node, constraint_x,
                                                  constraint_y),
                    .inertia = inertia_of(inertia_row, inertia_coordinate, inertia_weight),
                    .flow = flow,
                    .drag = drag});
          }),
          "pipe"_a, "length"_a, "center"_a, "gyration_radius"_a, "drag_point"_a, "base"_a,
          "spring_joint"_a, "spring_stiffness"_a, "spring_damping"_a, "spring_rest"_a, "flow"_a,
          "drag"_a, "constraint_kind"_a, "constraint_node"_a, "constraint_x"_a, "constraint_y"_a,
          "inertia_row"_a, "inertia_coordinate"_a, "inertia_weight"_a)
      .def_property_readonly("coordinates", &Scene::coordinates)
      .def("straight", &Scene::straight, Unlocked())
      .def("operators",
           [](const Scene& scene) {
             const RedundantOperators ops = unlocked([&] { return scene.operators(); });
             py::typing::Dict<py::str, TripletArrays> made;
             made["mass"] = arrays_of(ops.mass);
             made["gyroscopic"] = arrays_of(ops.gyroscopic);
             made["end_flux"] = arrays_of(ops.end_flux);
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
          "curvature",
          [](const Scene& scene, const Vector& q, const Vector& multipliers) {
            return arrays_of(unlocked([&] { return scene.curvature(q, multipliers); }));
          },
          "q"_a, "multipliers"_a)
      .def(
          "acceleration_derivatives",
          [](const Scene& scene, const Vector& y, const Vector& acceleration) {
            return pair_of(
                unlocked([&] { return scene.acceleration_derivatives(y, acceleration); }));
          },
          "y"_a, "acceleration"_a)
      .def("from_angles", scene_from_angles, "theta"_a, "omega"_a)
      .def(
          "project",
          [](const Scene& scene, Matrix theta, Matrix omega) {
            scene.project(theta, omega);
            return std::make_pair(theta, omega);
          },
          "theta"_a, "omega"_a, Unlocked())
      .def_property_readonly_static("return_rate",
                                    [](const py::object&) { return Scene::return_rate; })
      .def("angle_rates", scene_angle_rates, "t"_a, "y"_a, "u"_a)
      .def("rhs", scene_rhs, "t"_a, "y"_a, "u"_a, "force"_a = py::none())
      .def("energy", scene_energy, "y"_a)
      .def("power", scene_power, "y"_a, "u"_a)
      .def("lacking", &Scene::lacking, "q"_a, Unlocked());
}

}  // namespace pipedyn
