// SPDX-License-Identifier: MIT
// The files of bindings/ are all that knows Python. They name and check the arguments and release
// the interpreter lock; they compute nothing.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/chain/chain.hpp"
#include "pipedyn/chain/spatial_chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/vector/levels.hpp"

namespace py = pybind11;
using namespace py::literals;
using pipedyn::Basis, pipedyn::Chain, pipedyn::Family, pipedyn::Galerkin, pipedyn::Operators,
    pipedyn::Pipe, pipedyn::Profile, pipedyn::Segments;
using pipedyn::Batch, pipedyn::Numbers, pipedyn::Speeds, pipedyn::States;
using pipedyn::NumberOrArray, pipedyn::own_numbers, pipedyn::Unlocked;

namespace {

/// A term as Python hands it over: name of its law, its arc length, the numbers of the law.
using TermArguments = std::tuple<std::string, double, std::vector<double>>;

pipedyn::End end_of(const std::string& name) {
  const std::string names[] = {"free", "guided", "pinned", "clamped"};
  for (int i = 0; i < 4; ++i) {
    if (name == names[i]) return static_cast<pipedyn::End>(i);
  }
  throw std::invalid_argument("end must be free, guided, pinned or clamped, got " + name);
}

template <class Model>
py::ssize_t work_of(const Model& motion) {
  return 4 * motion.dof() * motion.dof();
}
py::ssize_t work_of_chain(const pipedyn::SpatialChain& motion) { return 2 * motion.dof(); }

/// Defines what reduced models in a plane and in space share.
template <class Model>
py::class_<Model> define_reduced(py::module_& m, const char* name) {
  py::class_<Model> made(m, name);
  made.def(py::init([](const Pipe& pipe, bool legendre, pipedyn::Index size,
                       const pipedyn::Vector& joints, pipedyn::Index more,
                       pipedyn::Index least_nodes) {
             const Family family = legendre ? Family::legendre : Family::beam;
             return std::make_unique<Model>(pipe, Basis(family, size, joints, more, pipe),
                                            least_nodes);
           }),
           "pipe"_a, "legendre"_a, "size"_a, "joints"_a = pipedyn::Vector(), "more"_a = 0,
           "least_nodes"_a = 0)
      .def(
          "tips",
          [](const Model& model, const py::object& y) {
            const auto tips = [&](const Batch& batch, double* out) { model.tips(batch, out); };
            return pipedyn::results_of(2 * model.dof(), model.tip_rows(), work_of(model), y,
                                       py::float_(0.0), py::none(), tips);
          },
          "y"_a);
  pipedyn::define_equations<Model, work_of<Model>>(made);
  return made;
}

}  // namespace

PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
  m.doc() = "C++ core of pipedyn: operators, motion, eigenpairs of chains, reduced models, scenes.";

  m.def("vector_levels", pipedyn::vector_levels);
  m.def("vector_level", pipedyn::vector_level);
  m.def("set_vector_level", pipedyn::set_vector_level, "name"_a);
  pipedyn::motion_kernel();  // a wrong PIPEDYN_VECTOR_LEVEL shows at import

  py::class_<Profile>(m, "Profile")
      .def(py::init<>())
      .def(py::init<std::vector<double>, std::vector<std::vector<double>>>(), "ends"_a, "series"_a)
      .def(
          "__call__",
          [](const Profile& profile, const pipedyn::Vector& s) -> pipedyn::Vector {
            return s.unaryExpr([&](double at) { return profile(at); });
          },
          "s"_a);

  py::class_<Pipe>(m, "Pipe")
      .def(py::init([](const std::vector<double>& numbers, bool aspirating,
                       const std::vector<TermArguments>& terms, double root, const std::string& end,
                       std::vector<double> supports, Profile stiffness, Profile mass,
                       double root_across) {
             Pipe pipe{.aspirating = aspirating};
             for (std::size_t i = 0; i < numbers.size(); ++i) pipe.*own_numbers.at(i) = numbers[i];
             pipe.stiffness = std::move(stiffness);
             pipe.mass = std::move(mass);
             for (const auto& [law, at, numbers] : terms) {
               pipe.terms.push_back(pipedyn::make_term(law, at, numbers));
             }
             pipe.root = root;
             pipe.root_across = root_across;
             pipe.end = end_of(end);
             pipe.supports = std::move(supports);
             return pipe;
           }),
           "numbers"_a, "aspirating"_a, "terms"_a, "root"_a, "end"_a, "supports"_a, "stiffness"_a,
           "mass"_a, "root_across"_a)
      .def_property_readonly("resisted",
                             [](const Pipe& pipe) { return pipedyn::resist(pipe.terms); })
      .def_property_readonly("added_stiffness", [](const Pipe& pipe) {
        const auto [across, turning] = pipedyn::added_stiffness(pipe.terms);
        return std::tuple(across, turning);
      });
  m.def("is_felt_by_small_motions", &pipedyn::is_felt_by_small_motions, "law"_a);

  py::class_<Operators>(m, "Operators")
      .def_readonly("mass", &Operators::mass)
      .def_readonly("gyroscopic", &Operators::gyroscopic)
      .def_readonly("end_flux", &Operators::end_flux)
      .def_readonly("damping", &Operators::damping)
      .def_readonly("stiffness", &Operators::stiffness)
      .def_readonly("flux", &Operators::flux)
      .def_readonly("unsteady", &Operators::unsteady);

  const pipedyn::Vector none;
  py::class_<Segments>(m, "Segments")
      .def(py::init<pipedyn::Vector, pipedyn::Vector, pipedyn::Vector, pipedyn::Vector,
                    pipedyn::Vector, double, pipedyn::Vector, pipedyn::Vector, pipedyn::Vector>(),
           "length"_a, "center"_a, "gyration_radius"_a, "spring"_a, "drag_point"_a, "base"_a,
           "damping"_a = none, "rest_moment"_a = none, "mass"_a = none);
  py::class_<Chain, std::shared_ptr<Chain>>(m, "Chain")
      .def(py::init<const Pipe&, Segments>(), "pipe"_a, "segments"_a)
      .def(
          "joint_times",
          [](const Chain& chain, const pipedyn::Matrix& x, double stiffness, double damping,
             double mass, double velocity, double flux, double gravity, double by_damping,
             double unsteady) {
            return chain.joint_times(
                x, {stiffness, damping, mass, velocity, flux, gravity, by_damping, unsteady});
          },
          "x"_a, "stiffness"_a = 0.0, "damping"_a = 0.0, "mass"_a = 0.0, "velocity"_a = 0.0,
          "flux"_a = 0.0, "gravity"_a = 0.0, "by_damping"_a = 0.0, "unsteady"_a = 0.0, Unlocked())
      .def("guided", &Chain::guided, "held"_a)
      .def_property_readonly("joints", &Chain::joints)
      .def_property_readonly("elastic_scale", &Chain::elastic_scale)
      .def_property_readonly("turns_freely", &Chain::turns_freely)
      .def("bodies", &Chain::bodies);

  define_reduced<Galerkin>(m, "Galerkin")
      .def(
          "operators",
          [](const Galerkin& model, const pipedyn::Vector& q) {
            const std::string why = q.size() == model.dof() ? model.unresolved(q.data(), 1) : "";
            if (!why.empty()) pipedyn::refuse("operators", {0}, py::none(), why);
            const py::gil_scoped_release unlocked;
            return model.operators(q);
          },
          "q"_a = pipedyn::Vector())
      .def("nodes", &Galerkin::nodes, "q"_a, Unlocked())
      .def_property_readonly("supports", &Galerkin::supports)
      .def(
          "held",
          [](const Galerkin& model, const py::object& y) {
            const auto held = [&](const Batch& batch, double* out) { model.held(batch, out); };
            return pipedyn::results_of(2 * model.dof(), model.supports() * (1 + model.dof()),
                                       work_of(model), y, py::float_(0.0), py::none(), held);
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
      .def("elastic_stiffness", [](const Galerkin& model) { return model.basis().stiffness(); })
      .def("elastic", &Galerkin::elastic, Unlocked());
  define_reduced<pipedyn::SpatialGalerkin>(m, "SpatialGalerkin");

  py::class_<pipedyn::SpatialChain> spatial(m, "SpatialChain");
  spatial.def(py::init<const Pipe&, const Segments&, std::vector<pipedyn::Index>>(), "pipe"_a,
              "segments"_a, "held"_a = std::vector<pipedyn::Index>());
  pipedyn::define_equations<pipedyn::SpatialChain, work_of_chain>(spatial);

  m.def("ends", &pipedyn::ends, "angles"_a, "rates"_a, "lengths"_a, Unlocked());
  m.def(
      "gauss_nodes",
      [](pipedyn::Index count) {
        const pipedyn::Quadrature rule(count);
        return std::pair(rule.node, rule.weight);
      },
      "count"_a);

  pipedyn::define_linear(m);
  pipedyn::define_scene(m);
  pipedyn::define_motion(m);
  pipedyn::define_orbits(m);
}
