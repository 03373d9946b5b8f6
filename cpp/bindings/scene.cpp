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

/// No work if modules are written in Python: it keeps the interpreter lock and its thread.
py::ssize_t work_of(const Scene& scene) {
  if (scene.has_customs()) return 0;
  return scene.dof() * (1 + 3 * scene.row_count());
}

/// What the methods of a Python object, or None, add to the motion.
CustomForces custom_forces(const py::object& of) {
  if (of.is_none()) return {};
  return [of](const char* what, const Matrix& states) {
    const py::gil_scoped_acquire locked;
    return of.attr(what)(states).cast<Matrix>();
  };
}

}  // namespace

void define_scene(py::module_& m) {
  py::class_<Scene, std::shared_ptr<Scene>> defined(m, "Scene");
  define_equations<Scene, work_of>(defined);
  defined
      .def(py::init([](const Pipe& pipe, const Segments& segments, const std::vector<Index>& held,
                       const Vector& value, const Matrix& inertia, const py::object& customs) {
             return Scene(pipe, segments, held, value, inertia, custom_forces(customs));
           }),
           "pipe"_a, "segments"_a, "held"_a = std::vector<Index>(), "value"_a = Vector(),
           "inertia"_a = Matrix(), "customs"_a = py::none())
      .def_property_readonly("coordinates", &Scene::coordinates)
      .def_property_readonly("chain",
                             [](const std::shared_ptr<Scene>& scene) {
                               return std::shared_ptr<const Chain>(scene, &scene->chain());
                             })
      .def(
          "operators",
          [](const Scene& scene, const Vector& angles, bool joints) {
            return scene.chain().operators(angles, joints);
          },
          "angles"_a = Vector(), "joints"_a = true, Unlocked())
      .def(
          "free_accelerations",
          [](const Scene& scene, const Vector& theta) -> Vector {
            const double no_flow = 0.0;
            Vector y = Vector::Zero(2 * scene.dof()), rates = y;
            y.head(scene.dof()) = theta;
            scene.chain().rhs({y.data(), &no_flow, 1, 0}, rates.data());
            return rates.tail(scene.dof());
          },
          "theta"_a)
      .def(
          "redundant",
          [](const Scene& scene, const py::object& y) {
            const py::ssize_t n = scene.dof(), rows = 2 * scene.coordinates();
            const auto work = [&](const Batch& batch, double* out) {
              const Eigen::Map<const Matrix> states(batch.y, 2 * n, batch.members);
              Eigen::Map<Matrix>(out, rows, batch.members) =
                  scene.redundant(states.topRows(n), states.bottomRows(n));
            };
            return results_of(2 * n, rows, rows, y, py::float_(0.0), py::none(), work);
          },
          "y"_a)
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
      .def(
          "derivative",
          [](const Scene& scene, const py::object& y, const py::object& u,
             const py::object& drive) {
            const auto work = [&](const Batch& batch, double* out) {
              scene.derivative(batch, 0.0, out);
            };
            const py::ssize_t rows = 2 * scene.dof();
            return results_of(rows, rows, rows * work_of(scene), y, u, drive, work, true);
          },
          "y"_a, "u"_a, "drive"_a = py::none())
      .def(
          "redundant_rhs",
          [](const Scene& scene, const py::object&, const py::object& y, const py::object& u,
             const py::object& drive, bool refuses) {
            const auto work = [&](const Batch& states, double* out) {
              scene.redundant_rhs(states, out);
            };
            const py::ssize_t rows = 2 * scene.coordinates();
            Numbers made = results_of(rows, rows, work_of(scene), y, u, drive, work);
            if (refuses) require_answer("rhs", scene, rows, y, made, false);
            return made;
          },
          "t"_a, "y"_a, "u"_a, "drive"_a = py::none(), "refuses"_a = true);
}

}  // namespace pipedyn
