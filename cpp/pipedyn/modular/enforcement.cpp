// SPDX-License-Identifier: MIT
#include "pipedyn/modular/enforcement.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace pipedyn {

namespace {

/// A row of constraints this small against its coefficients follows from others: rounding leaves
/// some 1e-16 a stage of such a row.
constexpr double redundant = 1e-10;
/// An active coordinate that depends on a variable to this does so by rounding.
constexpr double unseen = 1e-15;
/// An inertia this small against the front's is none, both as square roots: a gyration radius of
/// 1e-13 L.
constexpr double massless = 1e-13;
/// Of squares; what is left of rounding after many stages would underflow.
constexpr double nothing = 1e-200;

}  // namespace

// ------------------------------------------------------------------------------------ symbolic

Enforcement::Enforcement(std::vector<double> scale, std::vector<InertiaRow> inertia,
                         std::vector<Group> groups)
    : scale_(std::move(scale)), inertia_(std::move(inertia)), groups_(std::move(groups)) {
  std::vector<char> touched(scale_.size(), 0);
  const auto touch = [&](const std::vector<int>& coordinates) {
    for (const int c : coordinates) touched[c] = 1;
  };
  for (const InertiaRow& row : inertia_) touch(row.coordinate);
  std::size_t entries = 0, rows = 0;
  for (const Group& group : groups_) {
    touch(group.coordinate);
    matrix_start_.push_back(entries);
    row_start_.push_back(rows);
    entries += group.coordinate.size() * group.rows;
    rows += group.rows;
  }
  for (std::size_t c = 0; c < scale_.size(); ++c) {
    if (!touched[c]) inertia_.push_back({{static_cast<int>(c)}, {0.0}});
  }

  // By the largest node, from the tip; its inertia precedes its groups.
  std::vector<Element> elements;
  const auto add = [&](bool constraint, std::size_t index, const std::vector<int>& touches) {
    const int last = touches.empty() ? -1 : *std::max_element(touches.begin(), touches.end());
    elements.push_back({constraint, static_cast<int>(index), last / node_size, touches});
  };
  for (std::size_t i = 0; i < inertia_.size(); ++i) add(false, i, inertia_[i].coordinate);
  for (std::size_t i = 0; i < groups_.size(); ++i) add(true, i, groups_[i].coordinate);
  std::stable_sort(elements.begin(), elements.end(), [](const Element& a, const Element& b) {
    return a.node != b.node ? a.node > b.node : !a.constraint && b.constraint;
  });

  std::vector<std::size_t> last(scale_.size(), 0);  // element that touches a coordinate
  for (std::size_t i = 0; i < elements.size(); ++i) {
    for (const int c : elements[i].slot) last[c] = i;
  }
  std::vector<int> active;  // coordinates that stay after the last stage
  for (std::size_t i = 0; i < elements.size();) {
    Stage stage;
    stage.coordinate = active;
    const auto before = static_cast<int>(active.size());
    for (bool deaths = false; i < elements.size() && !deaths; ++i) {
      Element& element = elements[i];
      for (int& slot : element.slot) {
        const int c = slot;
        auto& present = stage.coordinate;
        const auto found = std::find(present.begin(), present.end(), c);
        slot = static_cast<int>(found - present.begin());
        if (found == present.end()) present.push_back(c);
        deaths = deaths || last[c] == i;
      }
      if (element.constraint) {
        stage.group_rows = std::max(stage.group_rows, groups_[element.index].rows);
      } else {
        ++stage.inertia_rows;
      }
      stage.elements.push_back(std::move(element));
    }
    active.clear();
    const auto variables = static_cast<int>(stage.coordinate.size());
    for (int s = 0; s < variables; ++s) {
      const int c = stage.coordinate[s];
      (last[c] < i ? stage.leaving : stage.staying).push_back(s);
      if (last[c] >= i) active.push_back(c);
    }
    most_variables_ = std::max(most_variables_, variables);
    most_rows_ = std::max(most_rows_,
                          1 + variables + before + stage.group_rows + before + stage.inertia_rows);
    stages_.push_back(std::move(stage));
  }
}

// ------------------------------------------------------------------------------------- numeric

/// All that is affine in the variables z, a row each: g (which has no constant), the slots'
/// coordinates L z + p, the variables with which the stage began, the rows of the group being
/// enforced, and the energy's R z + r. Column 0 holds the constants, column v variable v.
class Enforcement::Front {
 public:
  /// An empty front with room for so many rows and variables.
  void reset(int most_rows, int most_variables) {
    stride_ = most_rows;
    const auto room = static_cast<std::size_t>(most_rows) * (most_variables + 1);
    if (data_.size() < room) data_.resize(room);
    product_.resize(most_rows);
    reflection_.resize(std::max(most_rows, most_variables + 1));
    variables_ = slots_ = began_ = energy_rows_ = 0;
  }

  int variables() const { return variables_; }
  int began() const { return began_; }
  int began_row() const { return 1 + slots_; }
  static int slot_row(int slot) { return 1 + slot; }
  const double* column(int variable) const { return data_.data() + variable * stride_; }

  /// What stays of the previous stage, and the coordinates that enter.
  void begin(const Stage& stage, const Front& previous, const std::vector<int>& staying,
             const double* scale, const double* force) {
    slots_ = static_cast<int>(stage.coordinate.size());
    began_ = previous.variables_;
    const auto kept = static_cast<int>(staying.size());
    variables_ = began_ + slots_ - kept;
    energy_first_ = 1 + slots_ + began_ + stage.group_rows;
    energy_rows_ = previous.energy_rows_;
    for (int v = 0; v <= variables_; ++v) {
      double* const to = writable(v);
      std::fill_n(to, end_row(), 0.0);
      if (v > began_) {
        const int s = kept + v - began_ - 1, c = stage.coordinate[s];
        to[slot_row(s)] = scale[c];
        to[0] = scale[c] * force[c];
        continue;
      }
      const double* const from = previous.column(v);
      for (int s = 0; s < kept; ++s) to[slot_row(s)] = from[slot_row(staying[s])];
      std::copy_n(from + previous.energy_first_, energy_rows_, to + energy_first_);
      if (v == 0) continue;
      to[0] = from[0];
      to[began_row() + v - 1] = 1.0;
    }
  }

  /// Adds 1/2 (sum_i weight_i a_i)^2 to the energy.
  void add_inertia(const Element& element, const std::vector<double>& weight) {
    const int row = end_row();
    ++energy_rows_;
    fill_row(row, element, weight.data(), 1.0);
  }

  /// sum_i matrix_ri a_i = b_r: a reflection of the variables leaves a row only the last of them,
  /// whose value is then known. The others span the rows' null space.
  void enforce(const Stage& stage, const Element& element, int rows, const double* matrix,
               const double* b, const double* scale) {
    const int first = began_row() + began_;
    const std::size_t touched = element.slot.size();
    for (int r = 0; r < rows; ++r) {
      const double* const entries = matrix + r * touched;
      double square = 0.0;
      for (std::size_t i = 0; i < touched; ++i) {
        const double entry = entries[i] * scale[stage.coordinate[element.slot[i]]];
        square += entry * entry;
      }
      const double weight = square > 0.0 ? 1.0 / std::sqrt(square) : 0.0;
      fill_row(first + r, element, entries, weight);
      writable(0)[first + r] -= weight * b[r];
    }
    for (int done = 0; done < rows; ++done) {
      int best = first;
      double most = 0.0;
      for (int row = first; row < first + rows; ++row) {
        const double norm = row_norm(row, 1);
        if (norm > most) {
          most = norm;
          best = row;
        }
      }
      if (!(most > redundant)) return;
      reflect(best, 1, variables_, most);
      const double* const last = column(variables_);
      double* const constant = writable(0);
      const double value = -constant[best] / last[best];
      for (int i = 0; i < end_row(); ++i) constant[i] += value * last[i];
      --variables_;
    }
  }

  /// Minimises the energy over all variables that no staying coordinate depends on. Returns one
  /// that has no inertia, or `complete`.
  int condense(const Stage& stage, const double* scale) {
    int seen = 0;
    for (; seen < variables_; ++seen) {
      int best = 0;
      double most = 0.0;
      for (const int slot : stage.staying) {
        const double norm = row_norm(slot_row(slot), seen + 1) / scale[stage.coordinate[slot]];
        if (norm > most) {
          most = norm;
          best = slot_row(slot);
        }
      }
      if (!(most > unseen)) break;
      reflect(best, seen + 1, seen + 1, row_norm(best, seen + 1));
    }
    const double largest = energy_square(heaviest(1, 0), 0);
    while (variables_ > seen) {
      const int best = heaviest(seen + 1, 0);
      if (!(energy_square(best, 0) > massless * massless * largest)) return best;
      std::swap_ranges(writable(best), writable(best) + (best < variables_ ? end_row() : 0),
                       writable(variables_));
      reflect_energy(variables_, 0);
      minimise_over_last(stage);
    }
    compress();
    return complete;
  }

 private:
  int stride_ = 0;
  std::vector<double> data_, product_, reflection_;
  int variables_ = 0, slots_ = 0, began_ = 0;
  int energy_first_ = 1, energy_rows_ = 0;

  int end_row() const { return energy_first_ + energy_rows_; }
  double* writable(int variable) { return data_.data() + variable * stride_; }

  /// The row becomes factor * sum_i weight_i a_i.
  void fill_row(int row, const Element& element, const double* weight, double factor) {
    for (int v = 0; v <= variables_; ++v) {
      double* const c = writable(v);
      double sum = 0.0;
      for (std::size_t i = 0; i < element.slot.size(); ++i) {
        sum += weight[i] * c[slot_row(element.slot[i])];
      }
      c[row] = factor * sum;
    }
  }

  double row_norm(int row, int first) const {
    double sum = 0.0;
    for (int v = first; v <= variables_; ++v) sum += column(v)[row] * column(v)[row];
    return std::sqrt(sum);
  }

  double energy_square(int variable, int first) const {
    const double* const c = column(variable) + energy_first_;
    double sum = 0.0;
    for (int i = first; i < energy_rows_; ++i) sum += c[i] * c[i];
    return sum;
  }

  /// The variable from `from` on of most energy, by its rows from `first` on.
  int heaviest(int from, int first) const {
    int best = variables_;
    double most = energy_square(best, first);
    for (int v = from; v < variables_; ++v) {
      const double square = energy_square(v, first);
      if (square > most) {
        most = square;
        best = v;
      }
    }
    return best;
  }

  /// Orthogonal change of the variables from `first` on after which the row has only `pivot`.
  void reflect(int row, int first, int pivot, double norm) {
    const int end = end_row();
    const double at_pivot = column(pivot)[row];
    const double image = at_pivot > 0.0 ? -norm : norm;
    for (int v = first; v <= variables_; ++v) reflection_[v] = column(v)[row];
    reflection_[pivot] -= image;
    const double factor = 1.0 / (norm * (norm + std::abs(at_pivot)));
    std::fill_n(product_.begin(), end, 0.0);
    for (int v = first; v <= variables_; ++v) {
      const double* const c = column(v);
      const double weight = reflection_[v];
      for (int i = 0; i < end; ++i) product_[i] += weight * c[i];
    }
    for (int v = first; v <= variables_; ++v) {
      double* const c = writable(v);
      const double weight = factor * reflection_[v];
      for (int i = 0; i < end; ++i) c[i] -= weight * product_[i];
      c[row] = v == pivot ? image : 0.0;
    }
  }

  /// Reflection of the energy's rows from `first` on after which, of these, only the first has the
  /// variable. The row of the largest entry comes first: so rows of different size keep their own
  /// digits.
  void reflect_energy(int variable, int first) {
    double* const x = writable(variable) + energy_first_;
    const double square = energy_square(variable, first);
    if (square < nothing) {
      std::fill(x + first, x + energy_rows_, 0.0);
      return;
    }
    int largest = first;
    for (int i = first; i < energy_rows_; ++i) {
      if (std::abs(x[i]) > std::abs(x[largest])) largest = i;
    }
    for (int v = 0; v <= variables_ && largest != first; ++v) {
      double* const c = writable(v) + energy_first_;
      std::swap(c[first], c[largest]);
    }
    const double norm = std::sqrt(square);
    const double image = x[first] > 0.0 ? -norm : norm;
    const double factor = 1.0 / (norm * (norm + std::abs(x[first])));
    for (int i = first; i < energy_rows_; ++i) reflection_[i] = x[i];
    reflection_[first] -= image;
    for (int v = 0; v <= variables_; ++v) {
      if (v == variable) continue;
      double* const c = writable(v) + energy_first_;
      double product = 0.0;
      for (int i = first; i < energy_rows_; ++i) product += reflection_[i] * c[i];
      product *= factor;
      for (int i = first; i < energy_rows_; ++i) c[i] -= product * reflection_[i];
    }
    std::fill(x + first, x + energy_rows_, 0.0);
    x[first] = image;
  }

  /// The last variable w, which only the energy's first row has: w = (h / T - B y - r) / T.
  void minimise_over_last(const Stage& stage) {
    const int top = energy_first_;
    const double* const last = column(variables_);
    const double t = last[top], push = last[0] / t;
    for (int v = 0; v < variables_; ++v) {
      double* const c = writable(v);
      const double share = v > 0 ? -c[top] / t : (push - c[top]) / t;
      for (int i = began_row(); i < began_row() + began_; ++i) c[i] += last[i] * share;
      for (const int slot : stage.leaving) c[slot_row(slot)] += last[slot_row(slot)] * share;
      if (v > 0) c[0] -= c[top] * push;
    }
    ++energy_first_;
    --energy_rows_;
    --variables_;
  }

  /// Leaves as many of the energy's rows as variables: R becomes triangular, columns permuted. The
  /// rows that follow have no variable that was done before.
  void compress() {
    if (energy_rows_ <= variables_) return;
    for (int first = 0; first < variables_; ++first) {
      const int best = heaviest(1, first);
      if (energy_square(best, first) < nothing) break;
      reflect_energy(best, first);
    }
    energy_rows_ = variables_;
  }
};

/// The variables with which a stage began and the coordinates that left in it, as what the
/// variables at its end make of them: column-major (began + leaving, 1 + variables), the constants
/// first.
struct Enforcement::Record {
  std::size_t values;  // where they begin
  int began, variables;
};

struct Enforcement::Workspace {
  Front fronts[2];
  std::vector<Record> records;
  std::vector<double> values, z, next;
};

template <class Found>
void Enforcement::substitute(Workspace& work, const Found& found) const {
  for (std::size_t s = work.records.size(); s-- > 0;) {
    const auto [start, began, variables] = work.records[s];
    const double* const values = work.values.data() + start;
    const int rows = began + static_cast<int>(stages_[s].leaving.size());
    work.next[0] = work.z[0];
    for (int i = 0; i < rows; ++i) {
      double sum = 0.0;
      for (int v = 0; v <= variables; ++v) sum += values[v * rows + i] * work.z[v];
      if (i < began) {
        work.next[1 + i] = sum;
      } else {
        found(stages_[s].coordinate[stages_[s].leaving[i - began]], sum);
      }
    }
    work.z.swap(work.next);
  }
}

int Enforcement::solve(const double* matrix, const double* b, const double* force,
                       double* accelerations) const {
  thread_local Workspace work;
  for (Front& front : work.fronts) front.reset(most_rows_, most_variables_);
  work.records.clear();
  work.values.clear();
  work.z.resize(most_variables_ + 1);
  work.next.resize(most_variables_ + 1);
  const std::vector<int> none;
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    const Stage& stage = stages_[s];
    Front& front = work.fronts[s % 2];
    front.begin(stage, work.fronts[(s + 1) % 2], s > 0 ? stages_[s - 1].staying : none,
                scale_.data(), force);
    for (const Element& element : stage.elements) {
      const auto index = static_cast<std::size_t>(element.index);
      if (element.constraint) {
        front.enforce(stage, element, groups_[index].rows, matrix + matrix_start_[index],
                      b + row_start_[index], scale_.data());
      } else {
        front.add_inertia(element, inertia_[index].weight);
      }
    }
    const int massless_variable = front.condense(stage, scale_.data());
    if (massless_variable != complete) {
      const double* const way = front.column(massless_variable);
      int coordinate = 0;
      double most = -1.0;
      const auto found = [&](int c, double value) {
        const double size = std::abs(value) / scale_[c];
        if (size > most) {
          most = size;
          coordinate = c;
        }
      };
      for (const int slot : stage.leaving) {
        found(stage.coordinate[slot], way[Front::slot_row(slot)]);
      }
      work.z[0] = 0.0;  // a change along the variable alone
      std::copy_n(way + front.began_row(), front.began(), work.z.begin() + 1);
      substitute(work, found);
      return coordinate;
    }
    work.records.push_back({work.values.size(), front.began(), front.variables()});
    for (int v = 0; v <= front.variables(); ++v) {
      const double* const c = front.column(v);
      const double* const first = c + front.began_row();
      work.values.insert(work.values.end(), first, first + front.began());
      for (const int slot : stage.leaving) work.values.push_back(c[Front::slot_row(slot)]);
    }
  }
  work.z[0] = 1.0;
  substitute(work, [&](int c, double value) { accelerations[c] = value; });
  return complete;
}

}  // namespace pipedyn
