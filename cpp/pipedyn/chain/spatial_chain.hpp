// SPDX-License-Identifier: MIT
//
// A chain (chain/chain.hpp) that moves in three dimensions. A state is [a_x, a_z, a_x', a_z'] with
// the rotation vectors of the segments' tangents (chain/space.hpp), (4 n).
#pragma once

#include "pipedyn/chain/chain.hpp"

namespace pipedyn {

class SpatialChain {
 public:
  /// held: indices of the segments whose ends are held, x = z = 0, ascending. Throws
  /// std::invalid_argument if arrays of the segments differ in length, and for a pipe whose
  /// equations in space are not known here: with joints that are bent at rest, or with a term that
  /// exists only in a plane.
  SpatialChain(const Pipe& pipe, const Segments& segments, std::vector<Index> held = {});

  /// Number of coordinates, 2 n.
  Index dof() const { return 2 * chain_.dof(); }

  /// Whether each segment may change its chart (motion/charts.hpp): not one with a law that reads
  /// its rotation vector.
  const std::vector<bool>& changes_charts() const { return changes_charts_; }

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
    ChainModel model = chain_.model();
    model.held = held_.data();
    model.held_count = static_cast<Index>(held_.size());
    model.return_rate = return_rate;
    (motion_kernel().spatial.*what)(model, batch, out);
  }
  static constexpr double return_rate = 60.0;  // that of a scene (modular)

  Chain chain_;
  std::vector<Index> held_;
  std::vector<bool> changes_charts_;
};

}  // namespace pipedyn
