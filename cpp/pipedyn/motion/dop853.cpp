// SPDX-License-Identifier: MIT
#include "pipedyn/motion/dop853.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>

#include "pipedyn/motion/dop853_coefficients.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// After which `advance` returns: so soon Ctrl-C is heard.
constexpr std::chrono::milliseconds pause{50};

/// Of Hairer, Norsett and Wanner: the step is chosen for `safety` of the error allowed and changes
/// by these factors at most.
constexpr double safety = 0.9, least_factor = 1.0 / 3.0, most_factor = 6.0;

/// Share of the last error in the choice of the next step. Without it steps bounce at the limit of
/// stability, where undamped chains hold them: a fifth of the evaluations, measured.
constexpr double memory = 0.08;

constexpr Index stages = 12;

/// c_s, where in the step a stage is.
double share(Index s) {
  return std::accumulate(dop853::weights[s - 1], dop853::weights[s - 1] + s, 0.0);
}

}  // namespace

Dop853::Dop853(Rates rates, Index rows, Index members, const double* start, double relative,
               double absolute, double most)
    : rates_(std::move(rates)),
      rows_(rows),
      relative_(relative),
      absolute_(absolute),
      most_(most),
      members_(static_cast<std::size_t>(members)),
      y_(Eigen::Map<const Vector>(start, rows * members)),
      next_(y_),
      stage_(y_),
      steps_(y_),
      scaled5_(y_),
      scaled3_(y_),
      rate_(stages + 4, y_) {
  for (Index j = 0; j < members; ++j) which_.push_back(j);
  tried_ = Vector::Zero(members);
  evaluate(y_, rate_[0], 0.0);
  choose_first_steps();
}

/// At a share of the steps that are tried.
void Dop853::evaluate(const Vector& y, Vector& rates, double share) {
  t_.resize(active());
  for (Index j = 0; j < active(); ++j) {
    Member& member = members_[which_[j]];
    t_[j] = member.time + share * tried_[j];
    ++member.evaluations;
  }
  rates_(t_, y.data(), which_, rates.data());
}

/// out = y + h sum_s weights_s k_s.
void Dop853::combine(const double* weights, Index terms, const Vector& y, Vector& out) {
  const double* k[stages + 1];
  for (Index s = 0; s < terms; ++s) k[s] = rate_[s].data();
  motion_kernel().combine(weights, k, terms, y.data(), steps_.data(), out.data(), entries());
}

/// A step at which an explicit Euler step and the change of the rates within it are small.
void Dop853::choose_first_steps() {
  const Index m = active();
  const auto norms = [&](const Vector& of, const Vector& from) {
    Vector sum = Vector::Zero(m);
    for (Index i = 0; i < entries(); i += m) {
      const auto allowed = absolute_ + relative_ * y_.segment(i, m).array().abs();
      sum.array() += ((of.segment(i, m) - from.segment(i, m)).array() / allowed).square();
    }
    return Vector((sum / static_cast<double>(rows_)).cwiseSqrt());
  };
  const Vector zero = Vector::Zero(entries()), size = norms(y_, zero), rate = norms(rate_[0], zero);
  Vector small(m);
  for (Index j = 0; j < m; ++j) {
    small[j] = size[j] < 1e-5 || rate[j] < 1e-5 ? 1e-6 : 0.01 * size[j] / rate[j];
  }
  steps_ = small.replicate(rows_, 1);
  stage_ = y_ + steps_.cwiseProduct(rate_[0]);
  tried_ = small;
  evaluate(stage_, rate_[1], 1.0);
  const Vector change = norms(rate_[1], rate_[0]);
  for (Index j = 0; j < m; ++j) {
    const double h = small[j], steepest = std::max(rate[j], change[j] / h);
    const double by_error =
        steepest < 1e-15 ? std::max(1e-6, 1e-3 * h) : std::pow(0.01 / steepest, 0.125);
    members_[j].step = std::isfinite(by_error) ? std::min(100.0 * h, by_error) : h;
  }
}

bool Dop853::advance(const Vector& times, double* out, Index evaluations) {
  const auto end = std::chrono::steady_clock::now() + pause;
  for (const Index w : which_) {  // samples at the start
    Member& member = members_[w];
    const Index m = active(), j = std::find(which_.begin(), which_.end(), w) - which_.begin();
    const Index count = times.size();
    for (; member.samples < count && times[member.samples] <= member.time; ++member.samples) {
      for (Index i = 0; i < rows_; ++i) {
        out[(w * count + member.samples) * rows_ + i] = y_[i * m + j];
      }
    }
    if (member.samples == count) member.progress = Progress::done;
  }
  drop_finished();
  for (Index taken = 0; !which_.empty() && taken < evaluations; taken += stages) {
    step(times, out);
    if (std::chrono::steady_clock::now() >= end) break;
  }
  return which_.empty();
}

void Dop853::step(const Vector& times, double* out) {
  const Index m = active();
  tried_.resize(m);
  for (Index j = 0; j < m; ++j) {
    const Member& member = members_[which_[j]];
    const double left = times[times.size() - 1] - member.time;
    tried_[j] = 1.01 * member.step < left ? member.step : left;
  }
  for (Index i = 0; i < entries(); i += m) steps_.segment(i, m) = tried_;
  for (Index s = 1; s < stages; ++s) {
    combine(dop853::weights[s - 1], s, y_, stage_);
    evaluate(stage_, rate_[s], share(s));
  }
  combine(dop853::weights[stages - 1], stages, y_, next_);
  measure_errors();
  accepted_.assign(static_cast<std::size_t>(m), 0);
  for (Index j = 0; j < m; ++j) control(j, times[times.size() - 1]);
  if (std::find(accepted_.begin(), accepted_.end(), 1) != accepted_.end()) {
    evaluate(next_, rate_[stages], 0.0);  // the members accepted have moved on
    sample(times, out);
    for (Index i = 0; i < entries(); i += m) {
      for (Index j = 0; j < m; ++j) {
        if (!accepted_[j]) continue;
        y_[i + j] = next_[i + j];
        rate_[0][i + j] = rate_[stages][i + j];
      }
    }
  }
  for (const Index w : which_) {
    const bool spent = static_cast<double>(members_[w].evaluations + stages + 3) > most_;
    if (spent && members_[w].progress == Progress::going) members_[w].progress = Progress::spent;
  }
  drop_finished();
}

/// Of each column, relative to what is allowed.
void Dop853::measure_errors() {
  const Index m = active();
  const Vector zero = Vector::Zero(entries());
  combine(dop853::error_weights[0], stages, zero, scaled5_);
  combine(dop853::error_weights[1], stages, zero, scaled3_);
  Vector fifth = Vector::Zero(m), third = Vector::Zero(m);
  for (Index i = 0; i < entries(); i += m) {
    for (Index j = 0; j < m; ++j) {
      const double largest = std::max(std::abs(y_[i + j]), std::abs(next_[i + j]));
      const double scale = 1.0 / (absolute_ + relative_ * largest);
      const double a = scaled5_[i + j] * scale, b = scaled3_[i + j] * scale;
      fifth[j] += a * a;
      third[j] += b * b;
    }
  }
  error_.resize(m);
  for (Index j = 0; j < m; ++j) {
    const double both = fifth[j] + 0.01 * third[j];
    error_[j] = both == 0.0 ? 0.0 : fifth[j] / std::sqrt(both * static_cast<double>(rows_));
  }
}

/// Accepts or rejects the step of a column and chooses the next.
void Dop853::control(Index j, double end) {
  Member& member = members_[which_[j]];
  const double error = error_[j], h = tried_[j];
  if (error <= 1.0) {
    const double exponent = 0.125 - 0.2 * memory;
    const double wanted = safety * std::pow(error, -exponent) * std::pow(member.last_error, memory);
    const double most = member.rejected ? 1.0 : most_factor;
    const double next = h * std::clamp(wanted, least_factor, most);
    member.step = h < member.step ? std::max(next, member.step) : next;
    member.last_error = std::max(error, 1e-4);
    member.time = h == end - member.time ? end : member.time + h;
    member.rejected = member.overflowed = false;
    accepted_[j] = 1;
    return;
  }
  const bool finite = std::isfinite(error);
  member.step = h * (finite ? std::max(safety * std::pow(error, -0.125), least_factor) : 0.1);
  member.rejected = true;
  member.overflowed |= !finite;
  if (0.1 * member.step <= 2.2e-16 * member.time || member.step == 0.0) {
    member.progress = member.overflowed ? Progress::not_finite : Progress::vanishing;
  }
}

/// Writes the samples within the steps accepted, by dense output of those columns alone.
void Dop853::sample(const Vector& times, double* out) {
  const Index m = active(), count = times.size();
  std::vector<Index> columns, which;
  for (Index j = 0; j < m; ++j) {
    const Member& member = members_[which_[j]];
    if (!accepted_[j] || times[member.samples] > member.time) continue;
    columns.push_back(j);
    which.push_back(which_[j]);
  }
  if (columns.empty()) return;
  const Index c = static_cast<Index>(columns.size());
  std::vector<Matrix> k(stages + 4, Matrix(rows_, c));
  Matrix from(rows_, c), to(rows_, c);
  for (Index i = 0; i < rows_; ++i) {
    for (Index j = 0; j < c; ++j) {
      const Index at = i * m + columns[j];
      from(i, j) = y_[at];
      to(i, j) = next_[at];
      for (Index s = 0; s <= stages; ++s) k[s](i, j) = rate_[s][at];
    }
  }
  const auto sum = [&](const double* weights, Index terms) {
    Matrix result = Matrix::Zero(rows_, c);
    for (Index s = 0; s < terms; ++s) {
      if (weights[s] != 0.0) result += weights[s] * k[s];
    }
    for (Index j = 0; j < c; ++j) result.col(j) *= tried_[columns[j]];
    return result;
  };
  t_.resize(c);
  for (Index s = stages + 1; s < stages + 4; ++s) {
    const Matrix at = from + sum(dop853::weights[s - 1], s);
    for (Index j = 0; j < c; ++j) {
      t_[j] = members_[which[j]].time - (1.0 - share(s)) * tried_[columns[j]];
    }
    rates_(t_, at.data(), which, k[s].data());
  }
  for (const Index w : which) members_[w].evaluations += 3;
  const double start_slope[] = {1.0};
  const Matrix rise = to - from, slope = sum(start_slope, 1);
  double both[stages + 1] = {1.0};
  both[stages] = 1.0;
  Matrix terms[7] = {rise, slope - rise, 2.0 * rise - sum(both, stages + 1)};
  for (Index t = 0; t < 4; ++t) terms[3 + t] = sum(dop853::dense_weights[t], stages + 4);
  for (Index j = 0; j < c; ++j) {
    Member& member = members_[which[j]];
    const double h = tried_[columns[j]];
    for (; member.samples < count && times[member.samples] <= member.time; ++member.samples) {
      const double x = 1.0 - (member.time - times[member.samples]) / h;
      double* const row = out + (which[j] * count + member.samples) * rows_;
      for (Index i = 0; i < rows_; ++i) {
        double value = 0.0;
        for (Index t = 6; t >= 0; --t)
          value = (value + terms[t](i, j)) * (t % 2 == 0 ? x : 1.0 - x);
        row[i] = from(i, j) + value;
      }
    }
    if (member.samples == count) member.progress = Progress::done;
  }
}

/// Takes the columns of members that go on together.
void Dop853::drop_finished() {
  const Index m = active();
  std::vector<Index> kept, which;
  for (Index j = 0; j < m; ++j) {
    if (members_[which_[j]].progress != Progress::going) continue;
    kept.push_back(j);
    which.push_back(which_[j]);
  }
  const Index c = static_cast<Index>(kept.size());
  if (c == m) return;
  for (Vector* of : {&y_, &rate_[0]}) {
    for (Index i = 0; i < rows_; ++i) {
      for (Index j = 0; j < c; ++j) (*of)[i * c + j] = (*of)[i * m + kept[j]];
    }
  }
  which_ = std::move(which);
}

}  // namespace pipedyn
