// SPDX-License-Identifier: MIT
// With the other files of bindings/ all that knows Python: names and checks the arguments, releases
// the interpreter lock, computes nothing.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/vector/levels.hpp"

namespace py = pybind11;
using namespace py::literals;
using pipedyn::Basis, pipedyn::Chain, pipedyn::Family, pipedyn::Galerkin, pipedyn::Operators,
    pipedyn::Pipe, pipedyn::Segments;
using pipedyn::Batch, pipedyn::Numbers, pipedyn::Speeds, pipedyn::States;
using pipedyn::NumberOrArray, pipedyn::Unlocked;

namespace {

/// Name of the law, arc length, the law's numbers.
using TermArguments = std::tuple<std::string, double, std::vector<double>>;

pipedyn::End end_of(const std::string& name) {
  const std::string names[] = {"free", "guided", "pinned", "clamped"};
  for (int i = 0; i < 4; ++i) {
    if (name == names[i]) return static_cast<pipedyn::End>(i);
  }
  throw std::invalid_argument("end must be free, guided, pinned or clamped, got " + name);
}

/// Work of a state, in that of a chain's segment.
py::ssize_t work_of(const Chain& chain) { return chain.dof(); }
py::ssize_t work_of(const Galerkin& motion) { return 4 * motion.dof() * motion.dof(); }

template <class Model>
Numbers jacobian(const Model& model, const py::object&, const py::object& y, const py::object& u,
                 const py::object& drive) {
  const auto work = [&](const Batch& batch, double* out) { model.jacobian(batch, out); };
  return pipedyn::jacobians_of(2 * model.dof(), work_of(model), y, u, drive, work);
}

template <class Model>
void define_equations(py::class_<Model>& model) {
  using py::object;
  // Rates of states that have so many rows besides [p, p'].
  const auto rates = [](auto work, py::ssize_t more) {
    return [work, more](const Model& of, const object&, const object& y, const object& u,
                        const object& drive) {
      const py::ssize_t rows = 2 * of.dof() + more;
      return pipedyn::results_of(rows, rows, work_of(of), y, u, drive,
                                 [&](const Batch& batch, double* out) { work(of, batch, out); });
    };
  };
  const auto drive = "drive"_a = py::none();
  model.def("rhs", rates(std::mem_fn(&Model::rhs), 0), "t"_a, "y"_a, "u"_a, drive)
      .def("rhs_and_power", rates(std::mem_fn(&Model::rhs_and_power), 1), "t"_a, "y"_a, "u"_a,
           drive)
      .def("jacobian", jacobian<Model>, "t"_a, "y"_a, "u"_a, drive)
      .def(
          "energy",
          [](const Model& of, const object& y, const object& drive) {
            return pipedyn::energy_of(of, 2 * of.dof(), work_of(of), y, drive);
          },
          "y"_a, drive)
      .def(
          "power",
          [](const Model& of, const object& y, const object& u, const object& drive) {
            return pipedyn::power_of(of, 2 * of.dof(), work_of(of), y, u, drive);
          },
          "y"_a, "u"_a, drive);
}

}  // namespace

PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
  m.doc() = "C++ core of pipedyn: operators, motion, eigenpairs of chains, reduced models, scenes.";

  m.def("vector_levels", pipedyn::vector_levels);
  m.def("vector_level", pipedyn::vector_level);
  m.def("set_vector_level", pipedyn::set_vector_level, "name"_a);
  m.def(
      "sincos",
      [](const Numbers& x) {
        Numbers sine(x.size()), cosine(x.size());
        pipedyn::motion_kernel().sincos(x.data(), x.size(), sine.mutable_data(),
                                        cosine.mutable_data());
        return py::make_tuple(sine, cosine);
      },
      "x"_a);
  pipedyn::motion_kernel();  // a wrong PIPEDYN_VECTOR_LEVEL shows at import

  py::class_<Pipe>(m, "Pipe")
      .def(py::init([](double beta, double gamma, double centrifugal, double drag, double damping,
                       bool aspirating, const std::vector<TermArguments>& terms, double root,
                       const std::string& end, std::vector<double> supports, double inflow_share,
                       double jet_angle) {
             Pipe pipe{beta,    gamma,      centrifugal,  drag,
                       damping, aspirating, inflow_share, jet_angle};
             for (const auto& [law, at, numbers] : terms) {
               pipe.terms.push_back(pipedyn::make_term(law, at, numbers));
             }
             pipe.root = root;
             pipe.end = end_of(end);
             pipe.supports = std::move(supports);
             return pipe;
           }),
           "beta"_a, "gamma"_a, "centrifugal"_a, "drag"_a, "damping"_a, "aspirating"_a,
           "terms"_a = std::vector<TermArguments>{},
           "root"_a = std::numeric_limits<double>::infinity(), "end"_a = "free",
           "supports"_a = std::vector<double>{}, "inflow_share"_a = 1.0, "jet_angle"_a = 0.0)
      .def_property_readonly("resisted",
                             [](const Pipe& pipe) { return pipedyn::resist(pipe.terms); });

  py::class_<Operators>(m, "Operators")
      .def_readonly("mass", &Operators::mass)
      .def_readonly("gyroscopic", &Operators::gyroscopic)
      .def_readonly("end_flux", &Operators::end_flux)
      .def_readonly("damping", &Operators::damping)
      .def_readonly("stiffness", &Operators::stiffness)
      .def_readonly("flux", &Operators::flux)
      .def_readonly("unsteady", &Operators::unsteady);

  py::class_<Chain> chain(m, "Chain");
  chain
      .def(py::init([](const Pipe& pipe, pipedyn::Vector length, pipedyn::Vector center,
                       pipedyn::Vector gyration_radius, pipedyn::Vector spring,
                       pipedyn::Vector drag_point, double base) {
             return Chain(pipe,
                          Segments{std::move(length), std::move(center), std::move(gyration_radius),
                                   std::move(spring), std::move(drag_point), base});
           }),
           "pipe"_a, "length"_a, "center"_a, "gyration_radius"_a, "spring"_a, "drag_point"_a,
           "base"_a)
      .def("operators", &Chain::operators, "angles"_a = pipedyn::Vector(), Unlocked())
      .def("joint_operators", &Chain::joint_operators, "scale"_a, Unlocked())
      .def(
          "joint_times",
          [](const Chain& chain, const pipedyn::Matrix& x, double still, double rate, double square,
             double velocity, double flux, double gravity, double unsteady) {
            return chain.joint_times(x, {still, rate, square, velocity, flux, gravity, unsteady});
          },
          "x"_a, "still"_a = 0.0, "rate"_a = 0.0, "square"_a = 0.0, "velocity"_a = 0.0,
          "flux"_a = 0.0, "gravity"_a = 0.0, "unsteady"_a = 0.0, Unlocked())
      .def("guided", &Chain::guided, "held"_a)
      .def("places", &Chain::places)
      .def("loads", &Chain::loads, "stations"_a);
  define_equations(chain);

  py::class_<Galerkin> galerkin(m, "Galerkin");
  galerkin
      .def(py::init([](const Pipe& pipe, bool legendre, pipedyn::Index size,
                       const pipedyn::Vector& joints, pipedyn::Index more,
                       pipedyn::Index least_nodes) {
             const Family family = legendre ? Family::legendre : Family::beam;
             return std::make_unique<Galerkin>(pipe, Basis(family, size, joints, more, pipe),
                                               least_nodes);
           }),
           "pipe"_a, "legendre"_a, "size"_a, "joints"_a = pipedyn::Vector(), "more"_a = 0,
           "least_nodes"_a = 0)
      .def("operators", &Galerkin::operators, "q"_a = pipedyn::Vector(), Unlocked())
      .def("nodes", &Galerkin::nodes, "q"_a, Unlocked())
      .def(
          "tips",
          [](const Galerkin& model, const py::object& y) {
            const auto tips = [&](const Batch& batch, double* out) { model.tips(batch, out); };
            return pipedyn::results_of(2 * model.dof(), 4, work_of(model), y, py::float_(0.0),
                                       py::none(), tips);
          },
          "y"_a)
      .def("functions_by_panel", [](const Galerkin& model) { return model.basis().by_panel(); })
      .def("most_on_a_panel", [](const Galerkin& model) { return model.basis().most_on_a_panel(); })
      .def(
          "basis",
          [](const Galerkin& model, const pipedyn::Vector& s, int derivative) {
            return model.basis().evaluate(s, derivative);
          },
          "s"_a, "derivative"_a, Unlocked())
      .def("elastic_stiffness", [](const Galerkin& model) { return model.basis().stiffness(); });
  define_equations(galerkin);

  pipedyn::define_linear(m);
  pipedyn::define_scene(m);
  pipedyn::define_motion(m);
}
