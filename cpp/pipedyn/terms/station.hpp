// SPDX-License-Identifier: MIT
//
// The interface between a law of force and the models: what a law reads of the pipe and what it
// returns. A term is a law at one place of the pipe, or per length all along it. A law does not
// depend on the model (chain, reduced model or scene): each model says once where its stations are
// and how it uses loads, slopes, mass and inertia.
//
// x is across the straight pipe and y along it, downward; t = (sin theta, cos theta). At a station
// with virtual displacement dr a term does the virtual work load . dr. With the velocity v and the
// acceleration a there, its mass adds mass a . dr to the virtual work of inertia and has weight
// like the mass of the pipe. A couple does the virtual work couple dtheta, and rotary inertia adds
// inertia theta'' dtheta.
//
// A law states only its load. The slopes of the load follow from it by forward differentiation at
// compile time: the types of the numbers say on which variables of the station they depend.
//
// The file is local to each translation unit, like vector/pack.hpp, since the kernels of all levels
// include it.
#pragma once

#include <utility>

#include "pipedyn/terms/dual.hpp"
#include "pipedyn/terms/space.hpp"
#include "pipedyn/vector/pack.hpp"

namespace {

/// The variables of a station by which loads are differentiated; y follows x, and vy follows vx.
enum Variable : int { by_position = 0, by_angle = 2, by_velocity = 3, by_rate = 5 };
constexpr int variables = 6;
static_assert(variables == most_variables);

/// A place of the moving pipe. Real is a number or a pack of them; with `differentiated` each entry
/// has derivatives by the variables of the station on which it depends.
template <class Real, bool differentiated = false>
struct Station {
  template <int variable>
  using Number = std::conditional_t<differentiated, Dual<Real, 1u << variable>, Real>;
  Number<by_position> x;                 // position
  Number<by_position + 1> y;             //
  Number<by_angle> theta, sine, cosine;  // angle of the tangent
  Number<by_velocity> vx;                // velocity
  Number<by_velocity + 1> vy;            //
  Number<by_rate> omega;                 // theta'
};

/// Stands for a component of the load that a law does not have.
struct None {};
constexpr None none;

/// A force, or a force per length, and a couple, which does work as theta turns. The rows of slopes
/// have this order.
template <class X, class Y, class Couple>
struct Load {
  X x;
  Y y;
  Couple couple = {};
};
template <class X, class Y, class Couple = None>
Load(X, Y, Couple = {}) -> Load<X, Y, Couple>;

/// A law without effect; each law redefines the functions in which it has one.
struct NoLaw {
  static constexpr bool along = false;  // acts per length, all along the pipe
  // The law acts between the pipe and its base, not the ground: where the base moves, the station
  // is relative to the base.
  static constexpr bool on_base = false;
  // The law has equations of motion of any amplitude, and not of small motions alone.
  static constexpr bool moves = true;
  // The load is that of an AppliedNow, which models make from the law and the drive of a batch.
  static constexpr bool applied = false;
  // The load is that of the potential `energy`, but for a part whose power is `power`. A law
  // without a potential needs neither: its power is that of its load.
  static constexpr bool has_potential = true;

  double mass() const { return 0.0; }        // mass, or mass per length
  double inertia() const { return 0.0; }     // rotary inertia, at one place
  double weightless() const { return 0.0; }  // part of the mass, at one place, without weight
  /// Mass per length, without weight, that takes part only in the velocity v_n = v . n normal to
  /// the pipe: it adds (n . a) n . dr to the virtual work of inertia. The rest of this inertia, of
  /// second degree in velocities, is the load of the law.
  double normal_mass() const { return 0.0; }
  /// The load at a station, in numbers or in numbers with derivatives; a component that the law
  /// does not have is `none`.
  Load<None, None, None> load(const auto&) const { return {none, none, none}; }
  /// Potential energy of the load, 0 on the straight pipe.
  template <class Real>
  Real energy(const Station<Real>&) const {
    return Real{};
  }
  /// Power of the part of the load that the potential does not contain.
  template <class Real>
  Real power(const Station<Real>&) const {
    return Real{};
  }

  // Load, energy and power of a pipe that moves in three dimensions.
  static constexpr bool reads_rotation = false;  // whether it reads the rotation vector there
  template <class Number>
  SpatialLoad<Number> load_in_space(const SpatialStation<Number>&) const {
    return {};
  }
  template <class Number>
  Number energy_in_space(const SpatialStation<Number>&) const {
    return Number{};
  }
  template <class Number>
  Number power_in_space(const SpatialStation<Number>&) const {
    return Number{};
  }
};

// -------------------------------------------------------------------- what models read of a law

template <class Law>
using DifferentiatedLoad =
    decltype(std::declval<const Law&>().load(std::declval<const Station<double, true>&>()));

/// Whether a law has a load.
template <class Law>
constexpr bool has_load = !std::is_same_v<DifferentiatedLoad<Law>, Load<None, None, None>>;

/// Whether a law states its load in space, or has none.
template <class Law>
constexpr bool states_space =
    !has_load<Law> || !std::is_same_v<decltype(&Law::template load_in_space<double>),
                                      decltype(&NoLaw::template load_in_space<double>)>;

template <class Component>
constexpr bool reads_rate = (variables_of<Component> >> by_rate & 1u) != 0;

/// Whether a law has a couple, or a force that depends on the rate of rotation.
template <class Law>
constexpr bool turns = []<class X, class Y, class Couple>(const Load<X, Y, Couple>*) {
  return !std::is_same_v<Couple, None> || reads_rate<X> || reads_rate<Y>;
}(static_cast<DifferentiatedLoad<Law>*>(nullptr));

/// A component of a load as a number: 0 if the law does not have it.
template <class Real>
inline Real number_of(const None&) {
  return Real{};
}
template <class Real, class Number>
inline Real number_of(const Number& x) {
  return Real{} + x;
}
template <class Real, unsigned mask>
inline Real number_of(const Dual<Real, mask>& x) {
  return x.value;
}

/// A load without derivatives; components that a law does not have are 0.
template <class Real>
struct Acting {
  Real x, y, couple;

  template <class X, class Y, class Couple>
  explicit Acting(const Load<X, Y, Couple>& load)
      : x(number_of<Real>(load.x)),
        y(number_of<Real>(load.y)),
        couple(number_of<Real>(load.couple)) {}
};

template <int variable, class Real>
PIPEDYN_INLINE inline auto seeded(const Real& value, const Real& slope) {
  return dual<1u << variable>(value, [&](int) { return slope; });
}

/// The load of a law at a station, with its derivatives by the variables of the station.
template <class Law, class Real>
PIPEDYN_FLATTEN inline auto differentiated_load(const Law& law, const Station<Real>& at) {
  const Real one = all<Real>(1.0);
  return law.load(Station<Real, true>{
      seeded<by_position>(at.x, one), seeded<by_position + 1>(at.y, one),
      seeded<by_angle>(at.theta, one), seeded<by_angle>(at.sine, at.cosine),
      seeded<by_angle>(at.cosine, Real(-at.sine)), seeded<by_velocity>(at.vx, one),
      seeded<by_velocity + 1>(at.vy, one), seeded<by_rate>(at.omega, one)});
}

/// Calls body(row, variable, slope) for the slopes of a load that are not 0 for all stations. Row
/// and variable are compile-time constants, each of a type of its own.
template <int row, class Body>
inline void for_each_slope(const auto&, const Body&) {}
template <int row, class Body, class Real, unsigned mask>
inline void for_each_slope(const Dual<Real, mask>& component, const Body& body) {
  for_each_variable<mask>(
      [&](auto k) { body(std::integral_constant<int, row>(), k, component.slope(k)); });
}
template <class X, class Y, class Couple, class Body>
inline void for_each_slope(const Load<X, Y, Couple>& load, const Body& body) {
  for_each_slope<0>(load.x, body);
  for_each_slope<1>(load.y, body);
  for_each_slope<2>(load.couple, body);
}

/// Derivatives of a load: rows are its components, columns the variables of the station.
template <class Real>
struct Slopes {
  Real by[3][variables] = {};
};

inline void add(Slopes<double>& sum, double weight, const Slopes<double>& more) {
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < variables; ++k) sum.by[row][k] += weight * more.by[row][k];
  }
}

/// The load of a law and its slopes at a place of the straight pipe at rest.
struct AtRest {
  Acting<double> load;
  Slopes<double> slopes;

  template <class Law>
  AtRest(const Law& law, double at) : AtRest(differentiated_load(law, straight(at))) {}

 private:
  static Station<double> straight(double at) { return {0.0, at, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0}; }
  template <class X, class Y, class Couple>
  explicit AtRest(const Load<X, Y, Couple>& found) : load(found) {
    for_each_slope(found, [&](int row, int k, double slope) { slopes.by[row][k] = slope; });
  }
};

/// The variables with which loads across the pipe and couples change in small motions:
/// displacements (`small_still`) and velocities (`small_moving`). small_rows: the rows of slopes of
/// these components.
constexpr int small_still[] = {by_position, by_angle}, small_moving[] = {by_velocity, by_rate};
constexpr int small_rows[] = {0, 2};

/// The station relative to a place (x, y) that moves with the velocity (vx, vy).
template <class Real>
Station<Real> about(const Station<Real>& at, const Real& x, const Real& y, const Real& vx,
                    const Real& vy) {
  return {at.x - x, at.y - y, at.theta, at.sine, at.cosine, at.vx - vx, at.vy - vy, at.omega};
}

/// Power of a load of a law but for the change of its potential.
template <class Law, class Real>
Real power_of(const Law& law, const Station<Real>& at, const Acting<Real>& load) {
  if constexpr (Law::has_potential) return law.power(at);
  using Of = DifferentiatedLoad<Law>;
  Real sum = load.x * at.vx;  // without what the law does not have
  if constexpr (!std::is_same_v<decltype(Of::y), None>) sum += load.y * at.vy;
  if constexpr (!std::is_same_v<decltype(Of::couple), None>) sum += load.couple * at.omega;
  return sum;
}

/// Power of a load in space but for the change of its potential.
template <class Law, class Number>
Number power_of(const Law& law, const SpatialStation<Number>& at, const SpatialLoad<Number>& load) {
  if constexpr (Law::has_potential) return law.power_in_space(at);
  return dot(load.force, at.v) + dot(load.couple, at.w);
}

/// Power that a load of a law adds to `power_of` as the base moves with the velocity
/// (vx, vy). The energy of the fluid that moves with the pipe is counted relative to the base, the
/// energy of springs relative to the ground.
template <class Law, class Real>
Real base_power(const Law& law, const Station<Real>& at, const Acting<Real>& load, const Real& vx,
                const Real& vy) {
  if constexpr (Law::on_base) return Real{};
  if (law.normal_mass() != 0.0) {
    const Station<Real> alone = about(at, Real{}, Real{}, vx, vy);
    const Acting<Real> own(law.load(alone));
    return (load.x - own.x) * alone.vx + (load.y - own.y) * alone.vy +
           (load.couple - own.couple) * at.omega;
  }
  return -(load.x * vx + load.y * vy);
}

/// The power that a load in space takes, which is minus that of base_power.
template <class Law, class Number>
Number base_loss(const Law& law, const SpatialStation<Number>& at, const SpatialLoad<Number>& load,
                 const Space<Number>& velocity) {
  if constexpr (Law::on_base) return Number{};
  if (law.normal_mass() == 0.0) return dot(load.force, velocity);
  const SpatialStation<Number> alone = at.about(Space<Number>{}, velocity);
  const SpatialLoad<Number> own = law.load_in_space(alone);
  return dot(own.force - load.force, alone.v) + dot(own.couple - load.couple, at.w);
}

/// Calls body with the station as a law reads it, relative to the base if it acts on that.
template <class Law, class Number, class Body>
void with_station(const Law&, const SpatialStation<Number>& at, const Space<Number>& place,
                  const Space<Number>& velocity, const Body& body) {
  if constexpr (Law::on_base) {
    body(at.about(place, velocity));
  } else {
    body(at);
  }
}

}  // namespace
