// SPDX-License-Identifier: MIT
#include "pipedyn/motion/integrator.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>

#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Time after which `advance` returns, so that Python can react to Ctrl-C.
constexpr std::chrono::milliseconds pause{50};

}  // namespace

Integrator::Integrator(Index rows, Index members, double time, const Limits& limits,
                       std::shared_ptr<Charts> charts)
    : rows_(rows),
      limits_(limits),
      members_(static_cast<std::size_t>(members)),
      which_(static_cast<std::size_t>(members)),
      charts_(std::move(charts)),
      ones_(Vector::Ones(rows)) {
  for (Member& member : members_) member.time = time;
  std::iota(which_.begin(), which_.end(), Index{0});
}

bool Integrator::advance(const Vector& times, double* out, Index evaluations,
                         std::vector<Interpolant>* steps) {
  const auto end = std::chrono::steady_clock::now() + pause;
  times_ = &times;
  out_ = out;
  steps_ = steps;
  for (const Index w : which_) {  // the samples at the start of the motion
    const Member& member = members_[w];
    if (member.samples < times.size() && times[member.samples] <= member.time) {
      record(w, {member.time, member.time, state(w).transpose()});
    }
  }
  drop_finished();
  for (Index taken = 0; !which_.empty() && taken < evaluations;) {
    taken += step(times[times.size() - 1]);
    drop_finished();
    if (steps != nullptr && steps->size() >= most_steps) break;
    if (std::chrono::steady_clock::now() >= end) break;
  }
  return which_.empty();
}

double Integrator::length(const Member& member, double end) const {
  const double to_end = left(member, end), longest = std::min(member.step, limits_.max_step);
  return 1.01 * longest < to_end ? longest : std::min(to_end, limits_.max_step);
}

void Integrator::move_on(Member& member, double h, double next, double end) {
  member.step = h < member.step ? std::max(next, member.step) : next;
  const double by = h + member.beyond, to = h == left(member, end) ? end : member.time + by;
  member.beyond = to == end ? 0.0 : by - (to - member.time);
  member.time = to;
  member.rejected = member.overflowed = false;
}

void Integrator::shorten(Member& member, double h) {
  member.step = h;
  member.rejected = true;
  if (0.1 * h <= 2.2e-16 * std::abs(member.time) || h == 0.0) {
    member.progress = member.overflowed ? Progress::not_finite : Progress::vanishing;
  }
}

bool Integrator::is_asked_for(const Member& member) const {
  return steps_ != nullptr || (*times_)[member.samples] <= member.time;
}

void Integrator::record(Index which, const Interpolant& step) {
  Member& member = members_[which];
  const Index count = times_->size(), degree = step.coefficients.rows() - 1;
  const double* const first = step.coefficients.data();
  powers_.resize(degree);
  terms_.resize(static_cast<std::size_t>(degree));
  for (Index i = 0; i < degree; ++i) terms_[i] = first + (i + 1) * rows_;
  for (; member.samples < count && (*times_)[member.samples] <= step.to; ++member.samples) {
    const double x = 1.0 - (step.to - (*times_)[member.samples]) / (step.to - step.from);
    for (Index i = 0; i < degree; ++i) powers_[i] = i == 0 ? x : x * powers_[i - 1];
    double* const state = out_ + (which * count + member.samples) * rows_;
    motion_kernel().combine(powers_.data(), terms_.data(), degree, first, ones_.data(), state,
                            rows_);
    leave_charts(which, state);
  }
  if (steps_ != nullptr && step.to > step.from) {
    steps_->push_back(step);
    if (charts_) {
      Matrix& with_signs = steps_->back().coefficients;
      with_signs.conservativeResize(Eigen::NoChange, rows_ + charts_->segments());
      with_signs.rightCols(charts_->segments()).setZero();
      with_signs.row(0).tail(charts_->segments()) = charts_->of(which).transpose();
    }
  }
  if (member.samples == count) member.progress = Progress::done;
}

/// Selects the members that advance together.
void Integrator::drop_finished() {
  const auto going = [this](Index w) { return members_[w].progress == Progress::going; };
  if (std::all_of(which_.begin(), which_.end(), going)) return;
  std::vector<Index> columns, which;
  for (std::size_t j = 0; j < which_.size(); ++j) {
    if (!going(which_[j])) continue;
    columns.push_back(static_cast<Index>(j));
    which.push_back(which_[j]);
  }
  keep(columns);
  which_ = std::move(which);
}

}  // namespace pipedyn
