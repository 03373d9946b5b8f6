// SPDX-License-Identifier: MIT
// The only file that knows Python: names the arguments, releases the interpreter lock, computes
// nothing.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>

#include "pipedyn/chain.hpp"
#include "pipedyn/galerkin.hpp"

namespace py = pybind11;
using namespace py::literals;
using pipedyn::Basis, pipedyn::Chain, pipedyn::Family, pipedyn::Galerkin, pipedyn::Operators,
    pipedyn::Pipe, pipedyn::Segments;

PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
  using Unlocked = py::call_guard<py::gil_scoped_release>;
  m.doc() = "C++ core of pipedyn: operators of the chain and of the reduced model.";

  py::class_<Pipe>(m, "Pipe")
      .def(py::init(
               [](double beta, double gamma, double alpha, double drag, double damping,
                  bool aspirating) { return Pipe{beta, gamma, alpha, drag, damping, aspirating}; }),
           "beta"_a, "gamma"_a, "alpha"_a, "drag"_a, "damping"_a, "aspirating"_a)
      .def_property_readonly("direction", &Pipe::direction)
      .def_property_readonly("centrifugal", &Pipe::centrifugal);

  py::class_<Operators>(m, "Operators")
      .def_readonly("mass", &Operators::mass)
      .def_readonly("gyroscopic", &Operators::gyroscopic)
      .def_readonly("end_flux", &Operators::end_flux)
      .def_readonly("damping", &Operators::damping)
      .def_readonly("stiffness", &Operators::stiffness)
      .def_readonly("flux", &Operators::flux);

  py::class_<Chain>(m, "Chain")
      .def(py::init([](const Pipe& pipe, pipedyn::Vector length, pipedyn::Vector center,
                       pipedyn::Vector gyration_radius, pipedyn::Vector spring,
                       pipedyn::Vector drag_point, double base) {
             return Chain(pipe,
                          Segments{std::move(length), std::move(center), std::move(gyration_radius),
                                   std::move(spring), std::move(drag_point), base});
           }),
           "pipe"_a, "length"_a, "center"_a, "gyration_radius"_a, "spring"_a, "drag_point"_a,
           "base"_a)
      .def("operators", &Chain::operators, Unlocked())
      .def("joint_operators", &Chain::joint_operators, "scale"_a, Unlocked())
      .def("mass_times", &Chain::mass_times, "x"_a, Unlocked())
      .def("velocity_times", &Chain::velocity_times, "x"_a, "transposed"_a = false, Unlocked())
      .def("flux_times", &Chain::flux_times, "x"_a, "transposed"_a = false, Unlocked())
      .def("gravity_times", &Chain::gravity_times, "x"_a, Unlocked())
      .def("springs_times", &Chain::springs_times, "joint_angles"_a, Unlocked())
      .def("band", &Chain::band, "lambda_"_a, "u"_a, Unlocked())
      .def_readonly_static("band_width", &Chain::band_width);

  py::class_<Galerkin>(m, "Galerkin")
      .def(py::init([](const Pipe& pipe, bool legendre, pipedyn::Index size, pipedyn::Vector nodes,
                       pipedyn::Vector weights) {
             return Galerkin(pipe, Basis(legendre ? Family::legendre : Family::beam, size),
                             std::move(nodes), std::move(weights));
           }),
           "pipe"_a, "legendre"_a, "size"_a, "nodes"_a, "weights"_a)
      .def("operators", &Galerkin::operators, Unlocked())
      .def(
          "basis",
          [](const Galerkin& model, const pipedyn::Vector& s, int derivative) {
            return model.basis().evaluate(s, derivative);
          },
          "s"_a, "derivative"_a, Unlocked())
      .def("elastic_stiffness", [](const Galerkin& model) { return model.basis().stiffness(); });
}
