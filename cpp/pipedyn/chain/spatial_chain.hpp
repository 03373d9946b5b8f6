// SPDX-License-Identifier: MIT
//
// A chain (chain/chain.hpp) that moves in three dimensions. A state is [a_x, a_z, a_x', a_z'] with
// the rotation vectors of the segments' tangents (chain/space.hpp), (4 n).
#pragma once

#include "pipedyn/chain/chain.hpp"

namespace pipedyn {

class SpatialChain {
 public:
  /// Throws std::invalid_argument if arrays of the segments differ in length, and for a pipe whose
  /// equations in space are not known here: held at its end or at supports, with joints that are
  /// bent at rest, or with a term that exists only in a plane.
  SpatialChain(const Pipe& pipe, const Segments& segments);

  const Chain& chain() const { return chain_; }
  /// Number of coordinates, 2 n.
  Index dof() const { return 2 * chain_.dof(); }

  // As for Chain, with 2 dof rows in a state.
  void rhs(const Batch& batch, double* rates) const { call(&Spatial::rhs, batch, rates); }
  void rhs_and_power(const Batch& batch, double* rates) const {
    call(&Spatial::rhs_and_power, batch, rates);
  }
  void jacobian(const Batch& batch, double* out) const { call(&Spatial::jacobian, batch, out); }
  void linearise(const Batch& batch, double* out) const { call(&Spatial::linearise, batch, out); }
  void energy(const Batch& batch, double* out) const { call(&Spatial::energy, batch, out); }
  void power(const Batch& batch, double* out) const { call(&Spatial::power, batch, out); }

 private:
  using Spatial = MotionKernel::Spatial;
  void call(MotionKernel::Function Spatial::* what, const Batch& batch, double* out) const {
    (motion_kernel().spatial.*what)(chain_.model(), batch, out);
  }

  Chain chain_;
};

}  // namespace pipedyn
