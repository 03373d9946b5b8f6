// SPDX-License-Identifier: MIT
// Bindings of the integrators in time.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "arguments.hpp"
#include "models.hpp"
#include "pipedyn/modular/systems.hpp"
#include "pipedyn/motion/dop853.hpp"
#include "pipedyn/motion/radau.hpp"
#include "pipedyn/motion/supply.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

using FlowsAt = std::function<void(const Vector& t, const std::vector<Index>& which, Flows& flows)>;

/// Writes the numbers of some of the members, in the memory that `out` has.
template <class All>
void pick(const All& all, const std::vector<Index>& which, Vector& out) {
  out.resize(static_cast<Index>(which.size()));
  for (Index j = 0; j < out.size(); ++j) out[j] = all[which[static_cast<std::size_t>(j)]];
}

/// A flow speed mean (1 + part cos(frequency t)) and a base at a cos(own t) - b sin(own t).
/// numbers: (mean, part, frequency, own, *a, *b), with three components of a and of b.
FlowsAt oscillating(const py::tuple& numbers) {
  const auto all = numbers.cast<std::array<double, 10>>();
  return [=](const Vector& t, const std::vector<Index>&, Flows& flows) {
    const auto [mean, part, frequency, own] = std::tie(all[0], all[1], all[2], all[3]);
    flows.u = mean * (1.0 + part * (frequency * t.array()).cos());
    flows.drive.resize(Drive::rows, t.size());
    flows.drive.row(0) = -(mean * part * frequency) * (frequency * t.array()).sin();
    const Eigen::RowVectorXd cosine = (own * t.array()).cos(), sine = (own * t.array()).sin();
    for (const Index k : {0, 1, 2}) {
      const double a = all[4 + k], b = all[7 + k];
      const auto row = [&](Index of_x, Index of_z) {
        return flows.drive.row(k < 2 ? of_x + k : of_z);
      };
      row(Drive::position, Drive::position_z) = a * cosine - b * sine;
      row(Drive::velocity, Drive::velocity_z) = -own * (a * sine + b * cosine);
      row(Drive::acceleration, Drive::acceleration_z) = own * own * (b * sine - a * cosine);
    }
  };
}

/// The flows that Python gives as u: steady speeds, one for each member; or for all members the
/// numbers of `oscillating`, or a function of time that returns the speed and the drive.
FlowsAt flows_at(const py::object& u) {
  if (py::isinstance<py::tuple>(u)) return oscillating(u);
  if (!PyCallable_Check(u.ptr())) {
    return [all = u.cast<Reals>()](const Vector&, const std::vector<Index>& which, Flows& flows) {
      pick(all, which, flows.u);
    };
  }
  return [u](const Vector& t, const std::vector<Index>&, Flows& flows) {
    const py::gil_scoped_acquire locked;
    flows.u.resize(t.size());
    for (Index j = 0; j < t.size(); ++j) {
      const auto value = u(t[j]).cast<std::vector<double>>();
      const Index rows = static_cast<Index>(value.size()) - 1;
      if (rows < Drive::rows || (j > 0 && rows != flows.drive.rows())) {
        throw py::value_error("u must give a speed and a drive");
      }
      if (j == 0) flows.drive.resize(rows, t.size());
      flows.u[j] = value[0];
      for (Index k = 0; k < rows; ++k) flows.drive(k, j) = value[static_cast<std::size_t>(1 + k)];
    }
  };
}

/// Computes the rates of states (rows, members), each at its own time and flow.
using FlowRates =
    std::function<void(const Vector& t, const double* y, const Flows& flows, double* rates)>;

/// Relative error that quadratures may leave in rates, as a share of the relative error of a step.
/// Were it the same at each step, it would be as large as that of one step after a thousand.
constexpr double quadrature_share = 1e-3;

/// Rates as a function of times and states alone. u: as for `flows_at`; rtol: relative error of a
/// step of each member; charts: those of the states, or null.
Rates at_flows(FlowRates of, const py::object& u, const Vector& rtol,
               const std::shared_ptr<const Charts>& charts = nullptr) {
  return [of = std::move(of), at = flows_at(u), errors = Vector(quadrature_share * rtol), charts,
          flows = Flows()](const Vector& t, const double* y, const std::vector<Index>& which,
                           double* rates) mutable {
    at(t, which, flows);
    pick(errors, which, flows.errors);
    if (charts) flows.charts = charts->of(which);
    of(t, y, flows, rates);
  };
}

/// Computes `count` numbers; they are NaN if a Python function that is called raises ValueError.
template <class Compute>
void or_nan(const Compute& compute, Index count, double* out) {
  try {
    compute();
  } catch (py::error_already_set& error) {
    const py::gil_scoped_acquire locked;
    if (!error.matches(PyExc_ValueError)) throw;
    std::fill_n(out, count, std::numeric_limits<double>::quiet_NaN());
  }
}

/// Rates, `rows` numbers a state, by a member function of a compiled model, such as `rhs`.
template <class Model, class Function>
FlowRates function_rates(const Model& model, Function function, Index rows) {
  return [&model, function, rows](const Vector&, const double* y, const Flows& flows,
                                  double* rates) mutable {
    or_nan([&] { std::invoke(function, model, flows.of(y), rates); }, rows * flows.u.size(), rates);
  };
}

/// Rates by a Python function of times (members,), states (rows, members) and speeds (members,).
FlowRates called_rates(const py::function& function, Index rows) {
  return [function, rows](const Vector& t, const double* y, const Flows& flows, double* rates) {
    const py::gil_scoped_acquire locked;
    const Index count = rows * t.size();
    const auto call = [&] {
      const Numbers found =
          function(t, Matrix(Eigen::Map<const Matrix>(y, rows, t.size())), flows.u);
      require_size("rates", found, count);
      std::copy_n(found.data(), count, rates);
    };
    or_nan(call, count, rates);
  };
}

/// Rates by a Python function; or of a model's states, [q', q''] or, if these have one row more,
/// the work done on them, also its rate, which is the power.
FlowRates flow_rates_of(const py::object& of, Index rows) {
  if (PyCallable_Check(of.ptr())) return called_rates(of, rows);
  FlowRates rates;
  with_compiled(of, [&]<class Model>(const Model& model) {
    const bool works = rows > 2 * model.dof();
    rates = function_rates(model, works ? &Model::rhs_and_power : &Model::rhs, rows);
  });
  return rates;
}

/// The supply at constant head that feeds the pipe of a compiled model.
struct Supplied : Supply {
  FlowRates steady;  // rates of [q, q', W] at a given flow, which do not depend on time
  std::function<void(const Batch&, double*)> axial;
  Index dof = 0;

  Supplied(const py::object& core, const Supply& supply) : Supply(supply) {
    with_compiled(core, [&]<class Model>(const Model& model) {
      if constexpr (requires { &Model::axial; }) {
        axial = [&model](const Batch& batch, double* out) { model.axial(batch, out); };
      } else {
        throw py::value_error("a supply at constant head feeds pipes that move in a plane");
      }
      dof = model.dof();
      steady = function_rates(model, &Model::rhs_and_power, 2 * dof + 1);
    });
  }

  /// Rates of the states [q, q', W, u] (2 dof + 2, members), NaN where the flow turns back. base:
  /// the motion of the base, or empty.
  void rates(const double* y, Index members, const Matrix& base, double* out) const {
    const Index work = 2 * dof;
    const Eigen::Map<const Matrix> states(y, work + 2, members);
    Eigen::Map<Matrix> found(out, work + 2, members);
    Flows flows;
    flows.u = states.row(work + 1).replicate(1, 2).transpose();
    flows.drive = Matrix::Zero(Drive::rows, 2 * members);
    if (base.size() > 0) flows.drive = base.replicate(1, 2);
    flows.drive.row(Drive::rate) << Vector::Zero(members).transpose(),
        Vector::Ones(members).transpose();
    const Matrix twice = states.topRows(work + 1).replicate(1, 2);
    Matrix both(work + 1, 2 * members), moved(3 * dof, 2 * members);
    steady({}, twice.data(), flows, both.data());
    moved << twice.topRows(work), both.middleRows(dof, dof);
    Matrix along(2 + 4 * dof, 2 * members);
    axial(flows.of(moved.data()), along.data());
    for (Index k = 0; k < members; ++k) {
      const Index other = members + k;
      const double u = flows.u[k];
      const double change = u < 0.0 ? std::numeric_limits<double>::quiet_NaN()
                                    : rate(u, along(1, k), along(0, k), along(0, other));
      found.col(k).head(work + 1) = both.col(k) + change * (both.col(other) - both.col(k));
      found(work + 1, k) = change;
    }
  }
};

/// Charts of the members of a batch of a chain in space; null for other models.
std::shared_ptr<Charts> charts_of(const py::object& of, Index members) {
  if (!py::isinstance<SpatialChain>(of)) return nullptr;
  return std::make_shared<Charts>(of.cast<const SpatialChain&>().changes_charts(), members);
}

Rates rates_of(const py::object& of, Index rows, const py::object& u, const Vector& rtol,
               const Supplied* supply, const std::shared_ptr<const Charts>& charts = nullptr) {
  if (supply == nullptr) return at_flows(flow_rates_of(of, rows), u, rtol, charts);
  return at_flows([supply](const Vector& t, const double* y, const Flows& flows,
                           double* rates) { supply->rates(y, t.size(), flows.drive, rates); },
                  u, rtol);
}

/// Jacobian by a Python function of a time, a state (rows,), its speed and, if anything drives it,
/// drive, its rows. Where it raises ValueError the Jacobian is NaN.
DenseSystems::Jacobian called_jacobian(const py::function& function, Index rows,
                                       const FlowAt& flow_at) {
  return [function, rows, flow_at](double t, const double* y, Index member, double* out) {
    const Flows flow = flow_at(t, member);
    const py::gil_scoped_acquire locked;
    const Numbers state(rows, y);
    const auto call = [&] {
      const Numbers found = flow.driven() ? function(t, state, flow.u[0],
                                                     Numbers(flow.drive.rows(), flow.drive.data()))
                                          : function(t, state, flow.u[0]);
      require_size("a Jacobian", found, rows * rows);
      std::copy_n(found.data(), rows * rows, out);
    };
    or_nan(call, rows * rows, out);
  };
}

/// The systems of an implicit step with the derivative of a compiled model's rates.
template <class Model>
std::unique_ptr<ShiftedSystems> shifted_systems(const Model& model, const FlowAt& flow_at) {
  if constexpr (std::is_same_v<Model, Scene>) {
    if (!model.has_customs()) return std::make_unique<SceneSystems>(model, flow_at);
  }
  const Index rows = 2 * model.dof();
  const auto slopes = [&model, flow_at, rows](double t, const double* y, Index member,
                                              double* out) {
    or_nan([&] { model.jacobian(flow_at(t, member).of(y), out); }, rows * rows, out);
  };
  return std::make_unique<DenseSystems>(slopes, rows);
}

/// Rates for the implicit integrator: of a compiled model those of [q, q'] by `rhs`, with the
/// power, which is integrated apart; else those of all rows.
ImplicitRates implicit_rates_of(const py::object& of, const py::object& jacobian, Index rows,
                                const py::object& u, const Vector& rtol, const Supplied* supply,
                                const std::shared_ptr<const Charts>& charts) {
  const FlowAt flow_at = [at = flows_at(u), charts](double t, Index member) {
    Flows flows;
    at(Vector::Constant(1, t), {member}, flows);
    if (charts) flows.charts = charts->of(std::vector<Index>{member});
    return flows;
  };
  ImplicitRates made;
  const auto compiled = [&]<class Model>(const Model& model) {
    const auto power = [parts = Matrix()](const Model& fed, const Batch& batch,
                                          double* out) mutable {
      parts.resize(5, batch.members);
      fed.power(batch, parts.data());
      Eigen::Map<Vector>(out, batch.members) = parts.colwise().sum();
    };
    const Index solved = 2 * model.dof();
    made = {at_flows(function_rates(model, &Model::rhs, solved), u, rtol, charts),
            at_flows(function_rates(model, power, 1), u, rtol, charts), solved,
            shifted_systems(model, flow_at)};
  };
  if (supply == nullptr && !PyCallable_Check(of.ptr())) {
    with_compiled(of, compiled);
    return made;
  }
  // At constant head the derivative is dense.
  return {rates_of(of, rows, u, rtol, supply), nullptr, rows,
          std::make_unique<DenseSystems>(called_jacobian(jacobian, rows, flow_at), rows)};
}

/// Angles, weights and gaps of `Stops`.
using StopNumbers = std::tuple<Matrix, Matrix, Vector>;

/// The explicit integrator if `jacobian` is None, otherwise the implicit one.
std::unique_ptr<Integrator> integrator(const py::object& of, const py::object& u,
                                       const Matrix& start, double t0, const Numbers& rtols,
                                       const Numbers& atols, double most, double max_step,
                                       const py::object& jacobian,
                                       const py::typing::Optional<Supplied>& at_head,
                                       const std::optional<StopNumbers>& stops) {
  const Supplied* const supply = at_head.is_none() ? nullptr : at_head.cast<const Supplied*>();
  const Index rows = start.rows(), members = start.cols();
  require_size("rtol", rtols, members);
  require_size("atol", atols, members * rows);
  const Vector rtol = Eigen::Map<const Vector>(rtols.data(), members);
  const Matrix atol = Eigen::Map<const Matrix>(atols.data(), rows, members);
  const Limits limits{rtol, atol, most, max_step};
  const std::shared_ptr<Charts> charts = charts_of(of, members);
  if (jacobian.is_none()) {
    return std::make_unique<Dop853>(rates_of(of, rows, u, rtol, supply, charts), rows, members,
                                    start.data(), t0, limits, charts);
  }
  std::optional<Stops> known;
  if (stops) {
    const auto& [angles, weights, gaps] = *stops;
    const Index columns = angles.size() > 0 ? angles.cols() : weights.cols();
    const bool fit = angles.size() == 0 || angles.rows() == weights.cols();
    if (!fit || gaps.size() != weights.rows() || columns > rows) {
      throw py::value_error("stops must have angles, weights and gaps that fit the states");
    }
    known = Stops{angles, weights, gaps};
  }
  return std::make_unique<Radau>(implicit_rates_of(of, jacobian, rows, u, rtol, supply, charts),
                                 rows, members, start.data(), t0, limits, std::move(known), charts);
}

/// Advances the motion and returns whether all members have finished and, if `follow`, the ends of
/// the steps and the coefficients of their polynomials.
auto advance(Integrator& motion, const Vector& times, Numbers out, Index evaluations, bool follow) {
  double* const to = out.mutable_data();
  std::vector<Interpolant> steps;
  bool finished = false;
  {
    const py::gil_scoped_release unlocked;
    finished = motion.advance(times, to, evaluations, follow ? &steps : nullptr);
  }
  std::vector<double> ends;
  std::vector<Matrix> coefficients;
  for (Interpolant& step : steps) {
    if (ends.empty()) ends.push_back(step.from);
    ends.push_back(step.to);
    coefficients.push_back(std::move(step.coefficients));
  }
  return std::tuple(finished, std::move(ends), std::move(coefficients));
}

}  // namespace

void define_motion(py::module_& m) {
  py::class_<Member>(m, "Member")
      .def_readonly("time", &Member::time)
      .def_readonly("samples", &Member::samples)
      .def_readonly("evaluations", &Member::evaluations)
      .def_property_readonly("progress", [](const Member& member) {
        constexpr const char* names[] = {"going", "done", "not finite", "vanishing", "spent"};
        return names[static_cast<int>(member.progress)];
      });
  py::class_<Supplied>(m, "Supply")
      .def(py::init([](const py::object& core, double head, double friction, double weight,
                       double root_of_beta, double direction) {
             return Supplied(core, {head, friction, weight, root_of_beta, direction});
           }),
           "core"_a, "head"_a, "friction"_a, "weight"_a, "root_of_beta"_a, "direction"_a,
           py::keep_alive<1, 2>())
      .def(
          "rates",
          [](const Supplied& supply, const Matrix& y, const Matrix& base) {
            Matrix out(y.rows(), y.cols());
            supply.rates(y.data(), y.cols(), base, out.data());
            return out;
          },
          "y"_a, "base"_a = Matrix());
  py::class_<Integrator>(m, "Integrator")
      .def(py::init(&integrator), "of"_a, "u"_a, "start"_a, "t0"_a, "rtol"_a, "atol"_a, "most"_a,
           "max_step"_a = std::numeric_limits<double>::infinity(), "jacobian"_a = py::none(),
           "supply"_a = py::none(), "stops"_a = py::none(), py::keep_alive<1, 2>(),
           py::keep_alive<1, 11>())
      .def("advance", advance, "times"_a, "out"_a.noconvert(), "evaluations"_a, "follow"_a = false)
      .def(
          "state",
          [](const Integrator& motion, Index member) {
            Vector y = motion.state(member);
            motion.leave_charts(member, y.data());
            return y;
          },
          "member"_a)
      .def("stop", &Integrator::stop, "member"_a)
      .def_property_readonly("members", &Integrator::members);
  m.def(
      "in_first_chart",
      [](Matrix states, const Matrix& signs) {
        if (states.rows() != signs.rows() || states.cols() != 4 * signs.cols()) {
          throw py::value_error("each segment of each state needs a sign");
        }
        for (Index k = 0; k < states.rows(); ++k) {
          Charts::leave(signs.row(k), states.row(k).data());
        }
        return states;
      },
      "states"_a, "signs"_a);
}

}  // namespace pipedyn
