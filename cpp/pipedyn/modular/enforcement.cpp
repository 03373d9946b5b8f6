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
/// A living coordinate that depends on a variable to this does so by rounding.
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
  const int coordinates = static_cast<int>(scale_.size());
  std::vector<char> touched(scale_.size(), 0);
  for (const InertiaRow& row : inertia_) {
    for (const int c : row.coordinate) touched[static_cast<std::size_t>(c)] = 1;
  }
  std::size_t entries = 0, rows = 0;
  for (const Group& group : groups_) {
    matrix_start_.push_back(entries);
    row_start_.push_back(rows);
    entries += group.coordinate.size() * static_cast<std::size_t>(group.rows);
    rows += static_cast<std::size_t>(group.rows);
    for (const int c : group.coordinate) touched[static_cast<std::size_t>(c)] = 1;
  }
  for (int c = 0; c < coordinates; ++c) {
    if (!touched[static_cast<std::size_t>(c)]) inertia_.push_back({{c}, {0.0}});
  }

  struct Item {
    int key;
    bool constraint;
    int index;
  };
  // The key is the largest node; its inertia precedes its groups.
  std::vector<Item> items;
  const auto key = [](const std::vector<int>& touches) {
    return touches.empty() ? -1 : *std::max_element(touches.begin(), touches.end()) / node_size;
  };
  for (std::size_t i = 0; i < inertia_.size(); ++i) {
    items.push_back({key(inertia_[i].coordinate), false, static_cast<int>(i)});
  }
  for (std::size_t i = 0; i < groups_.size(); ++i) {
    items.push_back({key(groups_[i].coordinate), true, static_cast<int>(i)});
  }
  std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return a.key != b.key ? a.key > b.key : !a.constraint && b.constraint;
  });
  const auto touches = [&](const Item& item) -> const std::vector<int>& {
    const auto i = static_cast<std::size_t>(item.index);
    return item.constraint ? groups_[i].coordinate : inertia_[i].coordinate;
  };

  std::vector<std::size_t> last(scale_.size(), 0);
  for (std::size_t i = 0; i < items.size(); ++i) {
    for (const int c : touches(items[i])) last[static_cast<std::size_t>(c)] = i;
  }
  std::vector<int> slot_of(scale_.size(), -1);
  std::vector<int> living;  // coordinates that survive the last stage
  Stage stage;
  const auto begin = [&] {
    stage = Stage{};
    stage.coordinate = living;
    for (std::size_t s = 0; s < living.size(); ++s) {
      slot_of[static_cast<std::size_t>(living[s])] = static_cast<int>(s);
    }
  };
  begin();
  for (std::size_t i = 0; i < items.size(); ++i) {
    Element element{items[i].constraint, items[i].index, {}};
    bool deaths = false;
    for (const int c : touches(items[i])) {
      int& slot = slot_of[static_cast<std::size_t>(c)];
      if (slot < 0) {
        slot = static_cast<int>(stage.coordinate.size());
        stage.coordinate.push_back(c);
      }
      element.slot.push_back(slot);
      deaths = deaths || last[static_cast<std::size_t>(c)] == i;
    }
    if (element.constraint) {
      const int count = groups_[static_cast<std::size_t>(element.index)].rows;
      stage.group_rows = std::max(stage.group_rows, count);
    } else {
      ++stage.inertia_rows;
    }
    stage.elements.push_back(std::move(element));
    if (!deaths && i + 1 < items.size()) continue;

    const std::size_t before = living.size();
    living.clear();
    for (std::size_t s = 0; s < stage.coordinate.size(); ++s) {
      const int c = stage.coordinate[s];
      if (last[static_cast<std::size_t>(c)] <= i) {
        stage.dying.push_back(static_cast<int>(s));
      } else {
        stage.surviving.push_back(static_cast<int>(s));
        living.push_back(c);
      }
    }
    const int variables = static_cast<int>(stage.coordinate.size());
    most_variables_ = std::max(most_variables_, variables);
    most_rows_ = std::max(most_rows_, 1 + variables + static_cast<int>(before) + stage.group_rows +
                                          static_cast<int>(before) + stage.inertia_rows);
    record_size_ += (before + stage.dying.size()) * (living.size() + 1);
    stages_.push_back(std::move(stage));
    begin();
  }
}

// ------------------------------------------------------------------------------------- numeric

/// All that is affine in the variables z, a row each: g (which has no constant), the slots'
/// coordinates L z + p, the variables with which the stage began, the rows of the group being
/// enforced, and the energy's R z + r. The variables are columns.
class Enforcement::Front {
 public:
  Front(int most_rows, int most_variables, double* memory)
      : stride_(most_rows),
        data_(memory),
        constant_(data_ + most_rows * most_variables),
        product_(constant_ + most_rows),
        reflection_(product_ + most_rows) {}

  static std::size_t size(int most_rows, int most_variables) {
    return static_cast<std::size_t>(most_rows) * static_cast<std::size_t>(most_variables + 2) +
           static_cast<std::size_t>(std::max(most_rows, most_variables));
  }

  int variables() const { return variables_; }
  int began() const { return began_; }
  int began_row() const { return 1 + slots_; }
  static int slot_row(int slot) { return 1 + slot; }
  /// Column of a variable; behind the last, the constants.
  const double* column(int variable) const {
    return variable < variables_ ? data_ + variable * stride_ : constant_;
  }

  /// What survives of the previous stage, and the coordinates that enter.
  void begin(const Stage& stage, const Front& previous, const std::vector<int>& survivors,
             const double* scale, const double* force) {
    slots_ = static_cast<int>(stage.coordinate.size());
    began_ = previous.variables_;
    const int kept = static_cast<int>(survivors.size());
    variables_ = began_ + slots_ - kept;
    energy_first_ = 1 + slots_ + began_ + stage.group_rows;
    energy_rows_ = previous.energy_rows_;
    for (int v = 0; v <= variables_; ++v) {
      double* const to = writable(v);
      std::fill_n(to, end_row(), 0.0);
      const bool constants = v == variables_;
      if (v >= began_ && !constants) continue;
      const double* const from = constants ? previous.constant_ : previous.column(v);
      for (int s = 0; s < kept; ++s) {
        to[slot_row(s)] = from[slot_row(survivors[static_cast<std::size_t>(s)])];
      }
      std::copy_n(from + previous.energy_first_, energy_rows_, to + energy_first_);
      if (constants) continue;
      to[0] = from[0];
      to[began_row() + v] = 1.0;
    }
    for (int s = kept; s < slots_; ++s) {
      double* const entering = writable(began_ + s - kept);
      const int c = stage.coordinate[static_cast<std::size_t>(s)];
      entering[slot_row(s)] = scale[c];
      entering[0] = scale[c] * force[c];
    }
  }

  /// Adds 1/2 (sum_i weight_i a_i)^2 to the energy.
  void add_inertia(const Element& element, const std::vector<double>& weight) {
    const int row = end_row();
    ++energy_rows_;
    for (int v = 0; v <= variables_; ++v) {
      writable(v)[row] = sum_of(element, weight.data(), column(v));
    }
  }

  /// sum_i matrix_ri a_i = b_r: a reflection of the variables leaves a row only the last of them,
  /// whose value is then known. The others span the rows' null space.
  void enforce(const Stage& stage, const Element& element, int rows, const double* matrix,
               const double* b, const double* scale) {
    const int first = began_row() + began_;
    const std::size_t touched = element.slot.size();
    for (int r = 0; r < rows; ++r) {
      const double* const entries = matrix + static_cast<std::size_t>(r) * touched;
      double square = 0.0;
      for (std::size_t i = 0; i < touched; ++i) {
        const auto slot = static_cast<std::size_t>(element.slot[i]);
        const double entry = entries[i] * scale[stage.coordinate[slot]];
        square += entry * entry;
      }
      const double weight = square > 0.0 ? 1.0 / std::sqrt(square) : 0.0;
      for (int v = 0; v <= variables_; ++v) {
        writable(v)[first + r] = weight * sum_of(element, entries, column(v));
      }
      constant_[first + r] -= weight * b[r];
    }
    for (int done = 0; done < rows; ++done) {
      int best = first;
      double most = 0.0;
      for (int row = first; row < first + rows; ++row) {
        const double norm = row_norm(row, 0);
        if (norm > most) {
          most = norm;
          best = row;
        }
      }
      if (!(most > redundant)) return;
      const int last = variables_ - 1;
      reflect(best, 0, last, most);
      const double* const c = column(last);
      const double value = -constant_[best] / c[best];
      for (int i = 0; i < end_row(); ++i) constant_[i] += value * c[i];
      --variables_;
    }
  }

  /// Minimises the energy over all variables that the surviving coordinates do not see. Returns one
  /// that has no inertia, or `complete`.
  int condense(const Stage& stage, const double* scale) {
    int seen = 0;
    for (; seen < variables_; ++seen) {
      int best = 0;
      double most = 0.0;
      for (const int slot : stage.surviving) {
        const double size = scale[stage.coordinate[static_cast<std::size_t>(slot)]];
        const double norm = row_norm(slot_row(slot), seen) / size;
        if (norm > most) {
          most = norm;
          best = slot_row(slot);
        }
      }
      if (!(most > unseen)) break;
      reflect(best, seen, seen, row_norm(best, seen));
    }
    double largest = 0.0;
    for (int v = 0; v < variables_; ++v) largest = std::max(largest, energy_square(v, 0));
    while (variables_ > seen) {
      const int w = variables_ - 1;
      int best = w;
      for (int v = seen; v < w; ++v) {
        if (energy_square(v, 0) > energy_square(best, 0)) best = v;
      }
      if (!(energy_square(best, 0) > massless * massless * largest)) return best;
      std::swap_ranges(writable(best), writable(best) + (best < w ? end_row() : 0), writable(w));
      reflect_energy(w, 0, w);
      minimise_over_last(stage);
    }
    compress();
    return complete;
  }

 private:
  int stride_;
  double *data_, *constant_, *product_, *reflection_;
  int variables_ = 0, slots_ = 0, began_ = 0;
  int energy_first_ = 1, energy_rows_ = 0;

  int end_row() const { return energy_first_ + energy_rows_; }
  double* writable(int variable) {
    return variable < variables_ ? data_ + variable * stride_ : constant_;
  }

  static double sum_of(const Element& element, const double* weight, const double* column) {
    double sum = 0.0;
    for (std::size_t i = 0; i < element.slot.size(); ++i) {
      sum += weight[i] * column[slot_row(element.slot[i])];
    }
    return sum;
  }

  double row_norm(int row, int first) const {
    double sum = 0.0;
    for (int v = first; v < variables_; ++v) {
      const double x = data_[v * stride_ + row];
      sum += x * x;
    }
    return std::sqrt(sum);
  }

  double energy_square(int variable, int first) const {
    const double* const c = column(variable) + energy_first_;
    double sum = 0.0;
    for (int i = first; i < energy_rows_; ++i) sum += c[i] * c[i];
    return sum;
  }

  /// Orthogonal change of the variables from `first` on after which the row sees only `pivot`.
  void reflect(int row, int first, int pivot, double norm) {
    const int end = end_row();
    const double at_pivot = column(pivot)[row];
    const double image = at_pivot > 0.0 ? -norm : norm;
    for (int v = first; v < variables_; ++v) reflection_[v] = column(v)[row];
    reflection_[pivot] -= image;
    const double factor = 1.0 / (norm * (norm + std::abs(at_pivot)));
    std::fill_n(product_, end, 0.0);
    for (int v = first; v < variables_; ++v) {
      const double* const c = column(v);
      const double weight = reflection_[v];
      for (int i = 0; i < end; ++i) product_[i] += weight * c[i];
    }
    for (int v = first; v < variables_; ++v) {
      double* const c = writable(v);
      const double weight = factor * reflection_[v];
      for (int i = 0; i < end; ++i) c[i] -= weight * product_[i];
      c[row] = 0.0;
    }
    writable(pivot)[row] = image;
  }

  /// Reflection of the energy's rows from `first` on after which, of these, only the first sees the
  /// variable; applied to the variables before `columns` and to the constant. The row of the
  /// largest entry comes first: so rows of different size keep their own digits.
  void reflect_energy(int variable, int first, int columns) {
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
    for (int v = 0; v <= columns; ++v) {
      if (v == variable && v < columns) continue;
      double* const c = (v < columns ? writable(v) : constant_) + energy_first_;
      double product = 0.0;
      for (int i = first; i < energy_rows_; ++i) product += reflection_[i] * c[i];
      product *= factor;
      for (int i = first; i < energy_rows_; ++i) c[i] -= product * reflection_[i];
    }
    std::fill(x + first, x + energy_rows_, 0.0);
    x[first] = image;
  }

  /// The last variable w, which only the energy's first row sees: w = (h / T - B y - r) / T.
  void minimise_over_last(const Stage& stage) {
    const int w = variables_ - 1, top = energy_first_;
    const double* const last = column(w);
    const double t = last[top], push = last[0] / t;
    const double shift = (push - constant_[top]) / t;
    for (int v = 0; v <= w; ++v) {
      double* const c = v < w ? writable(v) : constant_;
      const double share = v < w ? -c[top] / t : shift;
      for (int i = began_row(); i < began_row() + began_; ++i) c[i] += last[i] * share;
      for (const int slot : stage.dying) c[slot_row(slot)] += last[slot_row(slot)] * share;
      if (v < w) c[0] -= c[top] * push;
    }
    ++energy_first_;
    --energy_rows_;
    --variables_;
  }

  /// As many of the energy's rows as variables say all: R becomes triangular, columns permuted.
  void compress() {
    if (energy_rows_ <= variables_) return;
    for (int first = 0; first < variables_; ++first) {
      int best = -1;
      double most = -1.0;
      for (int v = 0; v < variables_; ++v) {
        // a variable done before sees none of these rows
        const double square = energy_square(v, first);
        if (square > most) {
          most = square;
          best = v;
        }
      }
      if (most < nothing) break;
      reflect_energy(best, first, variables_);
    }
    energy_rows_ = variables_;
  }
};

/// The variables with which a stage began and the coordinates that died in it, as what the
/// variables at its end make of them.
struct Enforcement::Record {
  const double* values;  // column-major (began + dying, variables), then the constants
  int began, variables;
};

namespace {

double* thread_memory(std::size_t count) {
  thread_local std::vector<double> kept;
  if (kept.size() < count) kept = std::vector<double>(count);
  return kept.data();
}

}  // namespace

template <class Found>
void Enforcement::substitute(const std::vector<Record>& records, double* z, double* next,
                             double constants, const Found& found) const {
  for (std::size_t s = records.size(); s-- > 0;) {
    const Record& record = records[s];
    const Stage& stage = stages_[s];
    const int rows = record.began + static_cast<int>(stage.dying.size());
    for (int i = 0; i < rows; ++i) {
      double sum = constants * record.values[record.variables * rows + i];
      for (int v = 0; v < record.variables; ++v) sum += record.values[v * rows + i] * z[v];
      if (i < record.began) {
        next[i] = sum;
      } else {
        const int slot = stage.dying[static_cast<std::size_t>(i - record.began)];
        found(stage.coordinate[static_cast<std::size_t>(slot)], sum);
      }
    }
    std::swap(z, next);
  }
}

int Enforcement::solve(const double* matrix, const double* b, const double* force,
                       double* accelerations) const {
  const std::size_t front_size = Front::size(most_rows_, most_variables_);
  const auto variables = static_cast<std::size_t>(most_variables_);
  double* const memory = thread_memory(2 * front_size + 2 * variables + record_size_);
  Front fronts[2] = {{most_rows_, most_variables_, memory},
                     {most_rows_, most_variables_, memory + front_size}};
  double* const z = memory + 2 * front_size;
  double* const next = z + variables;
  double* values = next + variables;
  thread_local std::vector<Record> records;
  records.clear();

  static const std::vector<int> none;
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    const Stage& stage = stages_[s];
    Front& front = fronts[s % 2];
    front.begin(stage, fronts[(s + 1) % 2], s > 0 ? stages_[s - 1].surviving : none, scale_.data(),
                force);
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
        const double size = std::abs(value) / scale_[static_cast<std::size_t>(c)];
        if (size > most) {
          most = size;
          coordinate = c;
        }
      };
      for (const int slot : stage.dying) {
        found(stage.coordinate[static_cast<std::size_t>(slot)], way[Front::slot_row(slot)]);
      }
      std::copy_n(way + front.began_row(), front.began(), z);
      substitute(records, z, next, 0.0, found);
      return coordinate;
    }
    records.push_back({values, front.began(), front.variables()});
    for (int v = 0; v <= front.variables(); ++v) {
      const double* const c = front.column(v);
      values = std::copy_n(c + front.began_row(), front.began(), values);
      for (const int slot : stage.dying) *values++ = c[Front::slot_row(slot)];
    }
  }
  substitute(records, z, next, 1.0, [&](int c, double value) { accelerations[c] = value; });
  return complete;
}

}  // namespace pipedyn
