// What was done on the page is a recorded input: the run comes out again, bit for bit.
import assert from 'node:assert/strict';
import { execFile } from 'node:child_process';
import { join } from 'node:path';
import { test } from 'node:test';
import { end, folder, last, program } from './real_box';

const skip = last !== 'replays' && 'tools/test --all replays the run';

test('the run replays bit for bit', { skip }, async () => {
  await end();
  const [status, text] = await new Promise<[number, string]>(done =>
    execFile(program, ['replay', join(folder, 'report', 'raw')],
      (error, out, err) => done([Number(error?.code ?? 0), `${out}${err}`])));
  console.log(text.trim().split('\n').slice(-3).join('\n'));
  assert.equal(status, 0, text);
});
