// SPDX-License-Identifier: MIT
//
// Vectors in three dimensions, and what laws of force read of a pipe that moves there and return.
// y is along the straight pipe, downward; x and z are across it.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include <array>

#include "pipedyn/terms/dual.hpp"

namespace {

template <class Number>
struct Space {
  Number x, y, z;

  friend Space operator+(const Space& a, const Space& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
  }
  friend Space operator-(const Space& a, const Space& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
  }
  template <class Factor>
  friend Space operator*(const Factor& factor, const Space& a) {
    return {factor * a.x, factor * a.y, factor * a.z};
  }
  void operator+=(const Space& b) { *this = *this + b; }
};

template <class Number>
inline Number dot(const Space<Number>& a, const Space<Number>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Number>
inline Space<Number> cross(const Space<Number>& a, const Space<Number>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
/// c + a x b, each component of which takes two instructions.
template <class Number>
inline Space<Number> plus_cross(const Space<Number>& c, const Space<Number>& a,
                                const Space<Number>& b) {
  return {c.x + a.y * b.z - a.z * b.y, c.y + a.z * b.x - a.x * b.z, c.z + a.x * b.y - a.y * b.x};
}

/// Two components across a segment, along n_x and n_z.
template <class Number>
struct Across {
  Number x, z;

  friend Across operator+(const Across& a, const Across& b) { return {a.x + b.x, a.z + b.z}; }
  friend Across operator-(const Across& a, const Across& b) { return {a.x - b.x, a.z - b.z}; }
  template <class Factor>
  friend Across operator*(const Factor& factor, const Across& a) {
    return {factor * a.x, factor * a.z};
  }
  Across turned() const { return {-z, x}; }
};

template <class Number>
inline Number dot(const Across<Number>& a, const Across<Number>& b) {
  return a.x * b.x + a.z * b.z;
}

/// A vector in the plane of x and y from these two components.
template <class Number>
inline Space<Number> in_plane(const std::array<double, 2>& of) {
  return {constant<Number>(of[0]), constant<Number>(of[1]), Number{}};
}

/// A place of the pipe in space. It refers to the direction of the pipe there.
template <class Number>
struct SpatialStation {
  Space<Number> r, v;                      // position and velocity
  const Space<Number>&t, &rate, &nx, &nz;  // tangent, its rate, and the axes across it
  const Across<Number>&a, &w;              // rotation vector and rates of the tangent
  const Number &e, &s;                     // functions E and S of the rotation vector

  /// The station relative to a place that moves.
  SpatialStation about(const Space<Number>& place, const Space<Number>& velocity) const {
    return {r - place, v - velocity, t, rate, nx, nz, a, w, e, s};
  }
};

/// A force, and a couple that does the virtual work couple . (n_x . dt, n_z . dt).
template <class Number>
struct SpatialLoad {
  Space<Number> force{};
  Across<Number> couple{};
};

/// The part of a vector across the straight pipe, with a factor of each component.
template <class Number>
inline Space<Number> off_axis(const Space<Number>& of, double x = 1.0, double z = 1.0) {
  return {x * of.x, Number{}, z * of.z};
}

}  // namespace
