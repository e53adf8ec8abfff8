// Nearest rank, as in rt/quantile.hpp: the r-th smallest of n values, with r the least rank for
// which r / n >= share. Null: there is none.
export function quantile(values: number[], share: number): number | null {
  const n = values.length;
  if (n === 0) return null;
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[rankOf(share, n) - 1]!;
}

function rankOf(share: number, n: number): number {
  if (!(share > 0)) return 1;
  if (share >= 1) return n;
  // The product may be off by a rounding: one step puts it right.
  let rank = Math.max(1, Math.floor(share * n));
  if (rank / n < share) ++rank;
  if (rank > 1 && (rank - 1) / n >= share) --rank;
  return rank;
}
