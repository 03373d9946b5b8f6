// SPDX-License-Identifier: MIT
// Integration in time.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <string>

#include "arguments.hpp"
#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/modular/systems.hpp"
#include "pipedyn/motion/dop853.hpp"
#include "pipedyn/motion/radau.hpp"

namespace pipedyn {

using namespace py::literals;

namespace {

/// Flow speeds and drives of members at times; drive (Drive::rows, members) or empty.
struct Flows {
  Reals u;
  Matrix drive;

  bool driven() const { return !drive.isZero(0.0); }
  Batch of(const double* y) const {
    return {.y = y,
            .u = u.data(),
            .members = u.size(),
            .u_step = 1,
            .drive = driven() ? drive.data() : nullptr};
  }
};
using FlowsAt = std::function<void(const Vector& t, const std::vector<Index>& which, Flows& flows)>;

/// A speed that pulsates and a base that oscillates, by their numbers.
FlowsAt oscillating(const py::tuple& numbers) {
  const auto [mean, part, frequency, x, y, own] = numbers.cast<std::array<double, 6>>();
  return [=](const Vector& t, const std::vector<Index>&, Flows& flows) {
    flows.u = mean * (1.0 + part * (frequency * t.array()).cos());
    flows.drive.resize(Drive::rows, t.size());
    flows.drive.row(0) = -(mean * part * frequency) * (frequency * t.array()).sin();
    const Eigen::RowVectorXd cosine = (own * t.array()).cos(), sine = (own * t.array()).sin();
    for (const Index k : {0, 1}) {
      const double along = k == 0 ? x : y;
      flows.drive.row(Drive::position + k) = along * cosine;
      flows.drive.row(Drive::velocity + k) = -(along * own) * sine;
      flows.drive.row(Drive::acceleration + k) = -(along * own * own) * cosine;
    }
  };
}

/// u: a steady speed a member, or for all a function of time to speed and drive, or the numbers of
/// `oscillating`.
FlowsAt flows_at(const py::object& u) {
  if (py::isinstance<py::tuple>(u)) return oscillating(u);
  if (!PyCallable_Check(u.ptr())) {
    return [all = u.cast<Reals>()](const Vector&, const std::vector<Index>& which, Flows& flows) {
      flows.u = all(which);
    };
  }
  return [u](const Vector& t, const std::vector<Index>&, Flows& flows) {
    const py::gil_scoped_acquire locked;
    flows.u.resize(t.size());
    flows.drive.resize(Drive::rows, t.size());
    for (Index j = 0; j < t.size(); ++j) {
      const auto value = u(t[j]).cast<std::array<double, 1 + Drive::rows>>();
      flows.u[j] = value[0];
      for (Index k = 0; k < Drive::rows; ++k) flows.drive(k, j) = value[1 + k];
    }
  };
}

/// A function of a compiled model's states at a flow each.
template <class Model, class Function>
Rates function_rates(const Model& model, const py::object& u, const Function& function) {
  return [&model, function, at = flows_at(u), flows = Flows()](const Vector& t, const double* y,
                                                               const std::vector<Index>& which,
                                                               double* rates) mutable {
    at(t, which, flows);
    function(model, flows.of(y), rates);
  };
}

/// Rates [q', q'', power] of a compiled model's states with the work done on them.
template <class Model>
Rates compiled_rates(const Model& model, const py::object& u) {
  return function_rates(model, u, std::mem_fn(&Model::rhs_and_power));
}

/// Those of a function of times, states (rows, members), their speeds and, if any, drive (Drive::
/// rows, members). A ValueError means that there are none.
Rates called_rates(const py::function& function, Index rows, const py::object& u) {
  return [function, rows, at = flows_at(u), flows = Flows()](const Vector& t, const double* y,
                                                             const std::vector<Index>& which,
                                                             double* rates) mutable {
    at(t, which, flows);
    const py::gil_scoped_acquire locked;
    const Index members = static_cast<Index>(which.size());
    Numbers states({rows, members});
    std::copy_n(y, rows * members, states.mutable_data());
    try {
      const py::object made =
          flows.driven() ? function(t, states, flows.u, flows.drive) : function(t, states, flows.u);
      const Numbers found = made.cast<Numbers>();
      if (found.size() != rows * members)
        throw py::value_error("rates must have the states' shape");
      std::copy_n(found.data(), rows * members, rates);
    } catch (py::error_already_set& error) {
      if (!error.matches(PyExc_ValueError)) throw;
      std::fill_n(rates, rows * members, std::numeric_limits<double>::quiet_NaN());
    }
  };
}

Rates rates_of(const py::object& of, Index rows, const py::object& u) {
  if (py::isinstance<Chain>(of)) return compiled_rates(of.cast<const Chain&>(), u);
  if (py::isinstance<Galerkin>(of)) return compiled_rates(of.cast<const Galerkin&>(), u);
  if (py::isinstance<Scene>(of)) return compiled_rates(of.cast<const Scene&>(), u);
  return called_rates(of, rows, u);
}

/// Those of the same states without the work, by rhs, with their derivative, and the power apart.
template <class Model>
ImplicitRates implicit_rates(const Model& model, const py::object& u,
                             void (Model::*rhs)(const Batch&, double*) const,
                             std::unique_ptr<ShiftedSystems> systems) {
  return {function_rates(model, u, std::mem_fn(rhs)),
          function_rates(model, u,
                         [](const Model& of, const Batch& batch, double* out) {
                           Matrix parts(5, batch.members);
                           of.power(batch, parts.data());
                           Eigen::Map<Vector>(out, batch.members) = parts.colwise().sum();
                         }),
          2 * model.dof(), std::move(systems)};
}

/// Of a function of a time, a state (rows,), its speed and, if any, drive (Drive::rows,).
DenseSystems::Jacobian called_jacobian(const py::function& function, Index rows,
                                       const FlowAt& flow_at) {
  return [function, rows, flow_at](double t, const double* y, Index member, double* out) {
    const Flow flow = flow_at(t, member);
    const py::gil_scoped_acquire locked;
    const Numbers state(rows, y);
    const py::object made = flow.driven
                                ? function(t, state, flow.u, Numbers(Drive::rows, flow.drive))
                                : function(t, state, flow.u);
    const Numbers found = made.cast<Numbers>();
    if (found.size() != rows * rows) throw py::value_error("a Jacobian must have a row a state");
    std::copy_n(found.data(), rows * rows, out);
  };
}

ImplicitRates implicit_rates_of(const py::object& of, const py::object& jacobian, Index rows,
                                const py::object& u) {
  const FlowAt flow_at = [at = flows_at(u)](double t, Index member) {
    Flows flows;
    at(Vector::Constant(1, t), {member}, flows);
    Flow one{.u = flows.u[0], .driven = flows.driven()};
    std::copy_n(flows.drive.data(), flows.drive.size(), one.drive);
    return one;
  };
  if (py::isinstance<Chain>(of)) {
    const Chain& chain = of.cast<const Chain&>();
    return implicit_rates(chain, u, &Chain::rhs, std::make_unique<ChainSystems>(chain, flow_at));
  }
  if (py::isinstance<Scene>(of)) {
    const Scene& scene = of.cast<const Scene&>();
    return implicit_rates(scene, u, &Scene::rhs, std::make_unique<SceneSystems>(scene, flow_at));
  }
  if (py::isinstance<Galerkin>(of)) {
    const Galerkin& model = of.cast<const Galerkin&>();
    const auto slopes = [&model, flow_at](double t, const double* y, Index member, double* out) {
      model.jacobian(flow_at(t, member).of(y), out);
    };
    return implicit_rates(model, u, &Galerkin::rhs,
                          std::make_unique<DenseSystems>(slopes, 2 * model.dof()));
  }
  return {rates_of(of, rows, u), nullptr, rows,
          std::make_unique<DenseSystems>(called_jacobian(jacobian, rows, flow_at), rows)};
}

/// Explicit without a Jacobian.
std::unique_ptr<Integrator> integrator(const py::object& of, const py::object& u,
                                       const Matrix& start, double t0, double rtol, double atol,
                                       double most, double max_step, const py::object& jacobian) {
  const Index rows = start.rows(), members = start.cols();
  const Limits limits{rtol, atol, most, max_step};
  if (jacobian.is_none()) {
    return std::make_unique<Dop853>(rates_of(of, rows, u), rows, members, start.data(), t0, limits);
  }
  return std::make_unique<Radau>(implicit_rates_of(of, jacobian, rows, u), rows, members,
                                 start.data(), t0, limits);
}

/// Goes on; whether all members have finished, and where asked for the ends of steps and their
/// polynomials' coefficients.
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
  py::class_<Integrator>(m, "Integrator")
      .def(py::init(&integrator), "of"_a, "u"_a, "start"_a, "t0"_a, "rtol"_a, "atol"_a, "most"_a,
           "max_step"_a = std::numeric_limits<double>::infinity(), "jacobian"_a = py::none(),
           py::keep_alive<1, 2>())
      .def("advance", advance, "times"_a, "out"_a.noconvert(), "evaluations"_a, "follow"_a = false)
      .def("state", &Integrator::state, "member"_a)
      .def("stop", &Integrator::stop, "member"_a)
      .def_property_readonly("members", &Integrator::members);
}

}  // namespace pipedyn
