// Cells of the cost map that move, as things to list: cells that lie close together are one.
export interface Moving { x: number; y: number; width: number }  // m; middle, and its longer side

const close = 0.15;  // m
const most = 8;

// The largest first.
export function moving(cells: [number, number][], cell = 0.05): Moving[] {
  const bins = new Map<string, [number, number][]>();
  const key = (i: number, j: number) => `${i} ${j}`;
  for (const [x, y] of cells) {
    const at = key(Math.floor(x / close), Math.floor(y / close));
    const bin = bins.get(at);
    if (bin) bin.push([x, y]);
    else bins.set(at, [[x, y]]);
  }
  const things: [number, number][][] = [];
  for (const start of [...bins.keys()]) {
    const thing: [number, number][] = [];
    const todo = [start];
    for (let at = todo.pop(); at !== undefined; at = todo.pop()) {
      const bin = bins.get(at);
      if (!bin) continue;
      bins.delete(at);
      thing.push(...bin);
      const [i, j] = at.split(' ').map(Number) as [number, number];
      for (let di = -1; di <= 1; ++di) {
        for (let dj = -1; dj <= 1; ++dj) todo.push(key(i + di, j + dj));
      }
    }
    if (thing.length > 0) things.push(thing);
  }
  return things.sort((a, b) => b.length - a.length).slice(0, most).map(thing => {
    const range = (k: 0 | 1) => [Math.min(...thing.map(p => p[k])),
      Math.max(...thing.map(p => p[k]))] as const;
    const [[x0, x1], [y0, y1]] = [range(0), range(1)];
    return { x: (x0 + x1) / 2, y: (y0 + y1) / 2, width: Math.max(x1 - x0, y1 - y0) + cell };
  });
}
