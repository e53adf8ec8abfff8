// Quantiles of the page follow the rule of rt/quantile.hpp.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { quantile } from '../src/wire/quantile';

const rising = (n: number) => Array.from({ length: n }, (_, i) => i + 1);

test('quantiles are of the nearest rank', () => {
  assert.equal(quantile([], 0.5), null);
  assert.equal(quantile([4, 1, 3, 2], 0.5), 2);
  assert.equal(quantile([5, 4, 1, 3, 2], 0.5), 3);
  // In double 0.07 * 100 is above 7.
  assert.equal(quantile(rising(100), 0.07), 7);
  assert.equal(quantile(rising(1000), 0.999), 999);
  for (const share of [0, -1, NaN]) assert.equal(quantile([3, 2, 9], share), 2);
  for (const share of [1, 1.5, Infinity]) assert.equal(quantile([3, 9, 2], share), 9);
  // In whole numbers: the least r with 100 r >= percent n.
  for (let percent = 1; percent <= 100; ++percent) {
    for (let n = 1; n <= 130; ++n) {
      const rank = Math.floor((percent * n + 99) / 100);
      assert.equal(quantile(rising(n).reverse(), percent / 100), rank, `${percent} % of ${n}`);
    }
  }
});
