// SPDX-License-Identifier: MIT
// With bindings/arguments.hpp the only file that knows Python: names and checks the arguments,
// releases the interpreter lock, computes nothing.
#include <pybind11/complex.h>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/typing.h>

#include "arguments.hpp"
#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/galerkin/motion.hpp"
#include "pipedyn/modular/scene.hpp"
#include "pipedyn/vector/levels.hpp"
#include "pipedyn/work.hpp"

namespace py = pybind11;
using namespace py::literals;
using pipedyn::Basis, pipedyn::Chain, pipedyn::Family, pipedyn::Galerkin, pipedyn::Operators,
    pipedyn::Pipe, pipedyn::Segments;
using pipedyn::Batch, pipedyn::GalerkinMotion, pipedyn::Numbers, pipedyn::Scene, pipedyn::Speeds,
    pipedyn::States, pipedyn::Triplets;

namespace {

/// Name of the law, arc length, the law's numbers.
using TermArguments = std::tuple<std::string, double, std::vector<double>>;

using Unlocked = py::call_guard<py::gil_scoped_release>;

Basis basis_of(bool legendre, pipedyn::Index size, const pipedyn::Vector& joints,
               pipedyn::Index more) {
  return Basis(legendre ? Family::legendre : Family::beam, size, joints, more);
}

/// Work of a state, in that of a chain's segment.
py::ssize_t work_of(const Chain& chain) { return chain.dof(); }
py::ssize_t work_of(const GalerkinMotion& motion) { return 4 * motion.dof() * motion.dof(); }

template <class Model>
Numbers rhs(const Model& model, const py::object&, const py::object& y, const py::object& u) {
  const py::ssize_t rows = 2 * model.dof();
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  Numbers rates = pipedyn::new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  double* const out = rates.mutable_data();
  pipedyn::run(work_of(model) * states.members, [&] { model.rhs(batch, out); });
  return rates;
}

template <class Model>
Numbers rhs_and_power(const Model& model, const py::object&, const py::object& y,
                      const py::object& u) {
  const py::ssize_t rows = 2 * model.dof() + 1;
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  Numbers rates = pipedyn::new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  double* const out = rates.mutable_data();
  pipedyn::run(work_of(model) * states.members, [&] { pipedyn::rhs_and_power(model, batch, out); });
  return rates;
}

template <class Model>
Numbers jacobian(const Model& model, const py::object&, const py::object& y, const py::object& u) {
  const py::ssize_t rows = 2 * model.dof();
  const States states("y", y, rows, false);
  const Speeds speeds("u", u, states);
  Numbers result({rows, rows});
  const double* const state = states.values.data();
  double* const out = result.mutable_data();
  pipedyn::run(rows * work_of(model), [&] { model.jacobian(state, speeds.one, out); });
  return result;
}

using NumberOrArray = py::typing::Union<py::float_, Numbers>;

NumberOrArray number_or_array(const Numbers& values, bool number) {
  if (number) return py::float_(*values.data());
  return values;
}

template <class Model>
NumberOrArray energy(const Model& model, const py::object& y) {
  const States states("y", y, 2 * model.dof());
  const double still = 0.0;
  const Batch batch{states.values.data(), &still, states.members, 0};
  Numbers result(states.members);
  double* const out = result.mutable_data();
  pipedyn::run(work_of(model) * states.members, [&] { model.energy(batch, out); });
  return number_or_array(result, states.one);
}

/// (flow, joints, drag, others)
using Parts = py::typing::Tuple<NumberOrArray, NumberOrArray, NumberOrArray, NumberOrArray>;

template <class Model>
Parts power(const Model& model, const py::object& y, const py::object& u) {
  const States states("y", y, 2 * model.dof());
  const Speeds speeds("u", u, states);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  Numbers flow(states.members), joints(states.members), drag(states.members),
      others(states.members);
  const pipedyn::PowerParts parts{flow.mutable_data(), joints.mutable_data(), drag.mutable_data(),
                                  others.mutable_data()};
  pipedyn::run(work_of(model) * states.members, [&] { model.power(batch, parts); });
  return py::make_tuple(number_or_array(flow, states.one), number_or_array(joints, states.one),
                        number_or_array(drag, states.one), number_or_array(others, states.one));
}

template <class Model>
void define_motion(py::class_<Model>& model) {
  model.def("rhs", rhs<Model>, "t"_a, "y"_a, "u"_a)
      .def("rhs_and_power", rhs_and_power<Model>, "t"_a, "y"_a, "u"_a)
      .def("jacobian", jacobian<Model>, "t"_a, "y"_a, "u"_a)
      .def("energy", energy<Model>, "y"_a)
      .def("power", power<Model>, "y"_a, "u"_a);
}

// ------------------------------------------------------------------------------- modular route

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
  for (pipedyn::Index i = 0; i < first.size(); ++i) made.push_back(Item{first[i], parts[i]...});
  return made;
}

std::vector<pipedyn::Constraint> constraints_of(const Whole& kind, const Whole& node,
                                                const pipedyn::Vector& x,
                                                const pipedyn::Vector& y) {
  struct Given {
    std::int64_t kind;
    pipedyn::Index node;
    double x, y;
  };
  std::vector<pipedyn::Constraint> made;
  for (const Given& given : items<Given>("constraints", kind, node, x, y)) {
    made.push_back(
        {static_cast<pipedyn::Constraint::Kind>(given.kind), given.node, given.x, given.y});
  }
  return made;
}

Triplets triplets_of(const Whole& rows, const Whole& columns, const pipedyn::Vector& values) {
  return {
      {rows.begin(), rows.end()}, {columns.begin(), columns.end()}, {values.begin(), values.end()}};
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
                            pipedyn::shape_of(forces->values));
    }
  }
  Numbers rates = pipedyn::new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  const double* const more = forces ? forces->values.data() : nullptr;
  double* const out = rates.mutable_data();
  pipedyn::run(enforcement_work * scene.segments() * states.members,
               [&] { scene.rhs(batch, more, out); });
  return rates;
}

Numbers scene_angle_rates(const Scene& scene, const py::object&, const py::object& y,
                          const py::object& u) {
  const py::ssize_t rows = 2 * scene.segments() + 1;
  const States states("y", y, rows);
  const Speeds speeds("u", u, states);
  Numbers rates = pipedyn::new_numbers(rows, states.members, states.one);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  double* const out = rates.mutable_data();
  pipedyn::run(enforcement_work * scene.segments() * states.members,
               [&] { scene.angle_rates(batch, out); });
  return rates;
}

NumberOrArray scene_energy(const Scene& scene, const py::object& y) {
  const States states("y", y, 2 * scene.coordinates());
  const double still = 0.0;
  const Batch batch{states.values.data(), &still, states.members, 0};
  Numbers result(states.members);
  double* const out = result.mutable_data();
  pipedyn::run(scene.segments() * states.members, [&] { scene.energy(batch, out); });
  return number_or_array(result, states.one);
}

Parts scene_power(const Scene& scene, const py::object& y, const py::object& u) {
  const States states("y", y, 2 * scene.coordinates());
  const Speeds speeds("u", u, states);
  const Batch batch{states.values.data(), speeds.data(), states.members, speeds.step()};
  Numbers flow(states.members), joints(states.members), drag(states.members),
      others(states.members);
  const pipedyn::ScenePowerParts parts{flow.mutable_data(), joints.mutable_data(),
                                       drag.mutable_data(), others.mutable_data()};
  pipedyn::run(scene.segments() * states.members, [&] { scene.power(batch, parts); });
  return py::make_tuple(number_or_array(flow, states.one), number_or_array(joints, states.one),
                        number_or_array(drag, states.one), number_or_array(others, states.one));
}

/// Of angles (n,) the states (6 n,), of (n, k) the states (6 n, k).
Numbers scene_from_angles(const Scene& scene, const py::object& theta, const py::object& omega) {
  const States angles("theta", theta, scene.segments());
  const States rates("omega", omega, scene.segments());
  if (angles.one != rates.one || angles.members != rates.members) {
    throw py::value_error("omega must have the shape of theta, got " +
                          pipedyn::shape_of(rates.values));
  }
  using Columns = Eigen::Map<const pipedyn::Matrix>;
  const py::ssize_t rows = 2 * scene.coordinates();
  Numbers made = pipedyn::new_numbers(rows, angles.members, angles.one);
  const Columns of_angles(angles.values.data(), scene.segments(), angles.members);
  const Columns of_rates(rates.values.data(), scene.segments(), angles.members);
  Eigen::Map<pipedyn::Matrix>(made.mutable_data(), rows, angles.members) =
      scene.from_angles(of_angles, of_rates);
  return made;
}

template <class Work>
auto unlocked(const Work& work) {
  const py::gil_scoped_release released;
  return work();
}

py::typing::Tuple<TripletArrays, TripletArrays> pair_of(const pipedyn::Derivatives& derivatives) {
  return py::make_tuple(arrays_of(derivatives.by_coordinates), arrays_of(derivatives.by_rates));
}

void define_scene(py::module_& m) {
  using Reals = pipedyn::Vector;
  py::class_<Scene>(m, "Scene")
      .def(py::init([](const Pipe& pipe, pipedyn::Vector length, pipedyn::Vector center,
                       pipedyn::Vector gyration_radius, pipedyn::Vector drag_point, double base,
                       const Whole& spring_joint, const Reals& spring_stiffness,
                       const Reals& spring_damping, const Reals& spring_rest,
                       const Whole& transverse_node, const Reals& transverse_stiffness,
                       const Whole& dashpot_node, const Reals& dashpot_coefficient,
                       const Whole& mass_node, const Reals& mass, bool flow, bool drag,
                       const Whole& constraint_kind, const Whole& constraint_node,
                       const Reals& constraint_x, const Reals& constraint_y,
                       const Whole& inertia_rows, const Whole& inertia_columns,
                       const Reals& inertia) {
             return std::make_unique<Scene>(
                 pipe,
                 pipedyn::Modules{
                     .segments = {std::move(length), std::move(center), std::move(gyration_radius),
                                  pipedyn::Vector(), std::move(drag_point), base},
                     .springs = items<pipedyn::TorsionalSpring>(
                         "springs", spring_joint, spring_stiffness, spring_damping, spring_rest),
                     .transverse_springs = items<pipedyn::TransverseSpring>(
                         "transverse springs", transverse_node, transverse_stiffness),
                     .dashpots =
                         items<pipedyn::Dashpot>("dashpots", dashpot_node, dashpot_coefficient),
                     .masses = items<pipedyn::PointMass>("masses", mass_node, mass),
                     .constraints = constraints_of(constraint_kind, constraint_node, constraint_x,
                                                   constraint_y),
                     .inertia = triplets_of(inertia_rows, inertia_columns, inertia),
                     .flow = flow,
                     .drag = drag});
           }),
           "pipe"_a, "length"_a, "center"_a, "gyration_radius"_a, "drag_point"_a, "base"_a,
           "spring_joint"_a, "spring_stiffness"_a, "spring_damping"_a, "spring_rest"_a,
           "transverse_node"_a, "transverse_stiffness"_a, "dashpot_node"_a, "dashpot_coefficient"_a,
           "mass_node"_a, "mass"_a, "flow"_a, "drag"_a, "constraint_kind"_a, "constraint_node"_a,
           "constraint_x"_a, "constraint_y"_a, "inertia_rows"_a, "inertia_columns"_a, "inertia"_a)
      .def_property_readonly("coordinates", &Scene::coordinates)
      .def("straight", &Scene::straight, Unlocked())
      .def("operators",
           [](const Scene& scene) {
             const pipedyn::RedundantOperators ops = unlocked([&] { return scene.operators(); });
             py::typing::Dict<py::str, TripletArrays> made;
             made["mass"] = arrays_of(ops.mass);
             made["gyroscopic"] = arrays_of(ops.gyroscopic);
             made["end_flux"] = arrays_of(ops.end_flux);
             made["damping"] = arrays_of(ops.damping);
             made["stiffness"] = arrays_of(ops.stiffness);
             made["flux"] = arrays_of(ops.flux);
             return made;
           })
      .def("forces", &Scene::forces, "y"_a, "u"_a, Unlocked())
      .def(
          "force_derivatives",
          [](const Scene& scene, const pipedyn::Vector& y, double u) {
            return pair_of(unlocked([&] { return scene.force_derivatives(y, u); }));
          },
          "y"_a, "u"_a)
      .def(
          "constraints",
          [](const Scene& scene, const pipedyn::Vector& y)
              -> py::typing::Tuple<Numbers, TripletArrays, Numbers, Wholes> {
            const pipedyn::ConstraintRows rows = unlocked([&] { return scene.constraints(y); });
            return py::make_tuple(rows.residual, arrays_of(rows.matrix), rows.right_side,
                                  array_of(rows.group));
          },
          "y"_a)
      .def(
          "curvature",
          [](const Scene& scene, const pipedyn::Vector& q, const pipedyn::Vector& multipliers) {
            return arrays_of(unlocked([&] { return scene.curvature(q, multipliers); }));
          },
          "q"_a, "multipliers"_a)
      .def(
          "acceleration_derivatives",
          [](const Scene& scene, const pipedyn::Vector& y, const pipedyn::Vector& acceleration) {
            return pair_of(
                unlocked([&] { return scene.acceleration_derivatives(y, acceleration); }));
          },
          "y"_a, "acceleration"_a)
      .def("from_angles", scene_from_angles, "theta"_a, "omega"_a)
      .def(
          "project",
          [](const Scene& scene, pipedyn::Matrix theta, pipedyn::Matrix omega) {
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

}  // namespace

PYBIND11_MODULE(_core, m, py::mod_gil_not_used()) {
  m.doc() = "C++ core of pipedyn: operators and motion of the chain and of the reduced model.";

  m.def("vector_levels", pipedyn::vector_levels);
  m.def("vector_level", pipedyn::vector_level);
  m.def("set_vector_level", pipedyn::set_vector_level, "name"_a);
  m.def(
      "sincos",
      [](const Numbers& x) {
        Numbers sine(x.size()), cosine(x.size());
        pipedyn::sincos(x.data(), x.size(), sine.mutable_data(), cosine.mutable_data());
        return py::make_tuple(sine, cosine);
      },
      "x"_a);
  pipedyn::motion_kernel();  // a wrong PIPEDYN_VECTOR_LEVEL shows at import

  py::class_<Pipe>(m, "Pipe")
      .def(py::init([](double beta, double gamma, double centrifugal, double drag, double damping,
                       bool aspirating, const std::vector<TermArguments>& terms) {
             Pipe pipe{beta, gamma, centrifugal, drag, damping, aspirating};
             for (const auto& [law, at, numbers] : terms) {
               pipe.terms.push_back(pipedyn::make_term(law, at, numbers));
             }
             return pipe;
           }),
           "beta"_a, "gamma"_a, "centrifugal"_a, "drag"_a, "damping"_a, "aspirating"_a,
           "terms"_a = std::vector<TermArguments>{})
      .def_property_readonly("direction", &Pipe::direction);

  py::class_<Operators>(m, "Operators")
      .def_readonly("mass", &Operators::mass)
      .def_readonly("gyroscopic", &Operators::gyroscopic)
      .def_readonly("end_flux", &Operators::end_flux)
      .def_readonly("damping", &Operators::damping)
      .def_readonly("stiffness", &Operators::stiffness)
      .def_readonly("flux", &Operators::flux);

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
      .def("operators", py::overload_cast<>(&Chain::operators, py::const_), Unlocked())
      .def("operators", py::overload_cast<const pipedyn::Vector&>(&Chain::operators, py::const_),
           "angles"_a, Unlocked())
      .def("joint_operators", &Chain::joint_operators, "scale"_a, Unlocked())
      .def("mass_times", &Chain::mass_times, "x"_a, Unlocked())
      .def("velocity_times", &Chain::velocity_times, "x"_a, "transposed"_a = false, Unlocked())
      .def("flux_times", &Chain::flux_times, "x"_a, "transposed"_a = false, Unlocked())
      .def("gravity_times", &Chain::gravity_times, "x"_a, Unlocked())
      .def("springs_times", &Chain::springs_times, "joint_angles"_a, Unlocked())
      .def("terms_stiffness_times", &Chain::terms_stiffness_times, "x"_a, Unlocked())
      .def("terms_damping_times", &Chain::terms_damping_times, "x"_a, Unlocked())
      .def("bodies", &Chain::bodies, Unlocked())
      .def("resistances", &Chain::resistances, Unlocked())
      .def("band", &Chain::band, "lambda_"_a, "u"_a, Unlocked())
      .def_readonly_static("band_width", &Chain::band_width);
  define_motion(chain);

  py::class_<Galerkin>(m, "Galerkin")
      .def(py::init([](const Pipe& pipe, bool legendre, pipedyn::Index size,
                       const pipedyn::Vector& joints, pipedyn::Index more, pipedyn::Vector nodes,
                       pipedyn::Vector weights) {
             return Galerkin(pipe, basis_of(legendre, size, joints, more), std::move(nodes),
                             std::move(weights));
           }),
           "pipe"_a, "legendre"_a, "size"_a, "joints"_a, "more"_a, "nodes"_a, "weights"_a)
      .def("operators", &Galerkin::operators, Unlocked())
      .def(
          "basis",
          [](const Galerkin& model, const pipedyn::Vector& s, int derivative) {
            return model.basis().evaluate(s, derivative);
          },
          "s"_a, "derivative"_a, Unlocked())
      .def("term_stiffness", &Galerkin::term_stiffness, Unlocked())
      .def("elastic_stiffness", [](const Galerkin& model) { return model.basis().stiffness(); });
  m.def(
      "most_on_a_panel",
      [](pipedyn::Index size, const pipedyn::Vector& joints, pipedyn::Index more) {
        return basis_of(true, size, joints, more).most_on_a_panel();
      },
      "size"_a, "joints"_a, "more"_a);

  py::class_<GalerkinMotion> galerkin_motion(m, "GalerkinMotion");
  galerkin_motion
      .def(py::init([](const Pipe& pipe, bool legendre, pipedyn::Index size,
                       const pipedyn::Vector& joints, pipedyn::Index more,
                       pipedyn::Index least_nodes) {
             return std::make_unique<GalerkinMotion>(pipe, basis_of(legendre, size, joints, more),
                                                     least_nodes);
           }),
           "pipe"_a, "legendre"_a, "size"_a, "joints"_a = pipedyn::Vector(), "more"_a = 0,
           "least_nodes"_a = 0)
      .def("nodes", &GalerkinMotion::nodes, "q"_a, Unlocked())
      .def("operators", &GalerkinMotion::operators, "q"_a, Unlocked());
  define_motion(galerkin_motion);

  define_scene(m);
}
