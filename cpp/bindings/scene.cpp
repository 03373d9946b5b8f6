// SPDX-License-Identifier: MIT
// Bindings of the class Scene, which scenes put together from parts are compiled to.
#include "pipedyn/modular/scene.hpp"

#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "arguments.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

py::ssize_t work_of(const Scene& scene) {
  return scene.dof() * static_cast<py::ssize_t>(2 + 3 * scene.compliance().size());
}

/// Moments that custom parts exert on the segments, one column for each state, or none.
struct Moments {
  std::optional<States> given;

  Moments(const Scene& scene, const py::object& moments) {
    if (!moments.is_none()) given.emplace("moments", moments, scene.dof());
  }
  void add_to(Batch& batch) const {
    if (!given) return;
    if (batch.members != given->members) {
      throw std::invalid_argument("moments must have as many columns as y, got " +
                                  std::to_string(given->members));
    }
    batch.moments = given->values.data();
  }
};

/// Work on a batch of states y, (rows,) or (rows, k), with moments of custom parts and drives.
template <class Work>
Numbers scene_rates(const Scene& scene, py::ssize_t rows, const py::object& y, const py::object& u,
                    const py::object& moments, const py::object& drive, const Work& work) {
  const Moments further(scene, moments);
  return results_of(rows, rows, work_of(scene), y, u, drive, [&](Batch batch, double* out) {
    further.add_to(batch);
    work(batch, out);
  });
}

/// Redundant states (6 n,) from angles (n,), or (6 n, k) from (n, k).
Numbers from_angles(const Scene& scene, const py::object& theta, const py::object& omega) {
  const States angles("theta", theta, scene.dof());
  const States rates("omega", omega, scene.dof());
  if (angles.one != rates.one || angles.members != rates.members) {
    throw py::value_error("omega must have the shape of theta, got " + shape_of(rates.values));
  }
  using Columns = Eigen::Map<const Matrix>;
  const py::ssize_t rows = 2 * scene.coordinates();
  Numbers made = new_numbers(rows, angles.members, angles.one);
  Eigen::Map<Matrix>(made.mutable_data(), rows, angles.members) =
      scene.redundant(Columns(angles.values.data(), scene.dof(), angles.members),
                      Columns(rates.values.data(), scene.dof(), angles.members));
  return made;
}

/// Derivative of the rates of [theta, theta'], (2 n, 2 n), or (k, 2 n, 2 n) for k states. returns:
/// whether the rates include the return to guides and pins; by_state: derivative of the moments of
/// custom parts by a single state, (n, 2 n), or empty for 0.
Numbers derivative(const Scene& scene, const py::object& y, const py::object& u,
                   const py::object& moments, const Matrix& by_state, bool returns,
                   const py::object& drive) {
  const Moments further(scene, moments);
  const auto work = [&](Batch batch, double* out) {
    further.add_to(batch);
    scene.derivative(batch, returns ? Scene::return_rate : 0.0, by_state, out);
  };
  const py::ssize_t rows = 2 * scene.dof();
  return results_of(rows, rows, rows * work_of(scene), y, u, drive, work, true);
}

}  // namespace

void define_scene(py::module_& m) {
  py::class_<Scene> defined(m, "Scene");
  define_equations<Scene, work_of>(defined);
  defined
      .def(py::init<const Pipe&, const Segments&, const Matrix&, const std::vector<Index>&,
                    const Vector&>(),
           "pipe"_a, "segments"_a, "inertia"_a, "held"_a, "value"_a)
      .def_property_readonly("coordinates", &Scene::coordinates)
      .def_property_readonly("weights", &Scene::weights)
      .def_property_readonly("compliance", &Scene::compliance)
      .def("bodies", &Scene::bodies)
      .def_property_readonly("chain", &Scene::chain)
      .def("from_angles", from_angles, "theta"_a, "omega"_a)
      .def(
          "angles",
          [](const Scene& scene, const py::object& y) {
            const py::ssize_t rows = 2 * scene.dof();
            const auto work = [&](const Batch& states, double* out) {
              Eigen::Map<Matrix>(out, rows, states.members) = scene.angles(states);
            };
            return results_of(2 * scene.coordinates(), rows, rows, y, py::float_(0.0), py::none(),
                              work);
          },
          "y"_a)
      .def(
          "project",
          [](const Scene& scene, Matrix theta, Matrix omega) {
            Vector missed = scene.project(theta, omega);
            return std::make_tuple(theta, omega, missed);
          },
          "theta"_a, "omega"_a, Unlocked())
      .def_readonly_static("met", &Scene::met)
      .def_readonly_static("return_rate", &Scene::return_rate)
      .def("derivative", derivative, "y"_a, "u"_a, "moments"_a = py::none(),
           "by_state"_a = Matrix(), "returns"_a = true, "drive"_a = py::none())
      .def(
          "redundant_rhs",
          [](const Scene& scene, const py::object&, const py::object& y, const py::object& u,
             const py::object& moments, const py::object& drive, bool refuses) {
            const auto work = [&](const Batch& states, double* out) {
              scene.redundant_rhs(states, out);
            };
            const py::ssize_t rows = 2 * scene.coordinates();
            Numbers made = scene_rates(scene, rows, y, u, moments, drive, work);
            if (refuses) require_answer("rhs", scene, rows, y, made, false);
            return made;
          },
          "t"_a, "y"_a, "u"_a, "moments"_a = py::none(), "drive"_a = py::none(), "refuses"_a = true)
      .def(
          "rhs_and_power",
          [](const Scene& scene, const py::object&, const py::object& y, const py::object& u,
             const py::object& moments, const py::object& drive) {
            const auto work = [&](const Batch& batch, double* out) {
              scene.rhs_and_power(batch, out);
            };
            return scene_rates(scene, 2 * scene.dof() + 1, y, u, moments, drive, work);
          },
          "t"_a, "y"_a, "u"_a, "moments"_a, "drive"_a = py::none());
}

}  // namespace pipedyn
