// The status page: what the server has, for who wants to see that it runs.
const given = new URLSearchParams(location.hash.slice(1)).get('token');
if (given) {
  localStorage.setItem('vioapr-token', given);
  history.replaceState(null, '', location.pathname); // not in the history, nor in screenshots
}
const token = localStorage.getItem('vioapr-token');
const state = document.querySelector('#state');

async function ask(path, options) {
  try {
    return await fetch(path, options);
  } catch {
    throw new Error('The server does not answer: has it ended, or is the network another one?');
  }
}

async function get(path) {
  const answer = await ask(path, { headers: { authorization: `Bearer ${token}` } });
  if (answer.ok) return answer.json();
  throw new Error(answer.status === 401
    ? 'This browser does not know the token: open the address that vioapr serve prints.'
    : (await answer.json()).error);
}

function list(id, lines) {
  const section = document.querySelector(`#${id}`);
  section.querySelector('ul').replaceChildren(...lines.map((text) => {
    const item = document.createElement('li');
    item.textContent = text;
    return item;
  }));
  section.hidden = lines.length === 0;
}

const countOf = (count, noun) => `${count} ${noun}${count === 1 ? '' : 's'}`;

function describeScene(scene) {
  if (scene.problem) return `${scene.id}: ${scene.problem}`;
  const recordings = countOf(Object.keys(scene.recordings).length, 'recording');
  return `${scene.name}: ${recordings}, ${scene.has_map ? 'mapped' : 'not mapped'}`;
}

function describeJob({ job, progress }) {
  const steps = progress && progress.total ? ` (${progress.title}: ${progress.done} of ${progress.total})` : '';
  const why = job.state === 'done' || !job.message ? '' : `: ${job.message}`;
  return `${job.created_at.slice(0, 16).replace('T', ' ')} ${job.kind}, ${job.scene}: ${job.state}${steps}${why}`;
}

async function refresh() {
  try {
    const info = await (await ask('/api')).json();
    const [scenes, localizers, jobs] = await Promise.all(['/api/scenes', '/api/localizers', '/api/jobs'].map(get));
    state.textContent = `vioapr ${info.vioapr} runs. It holds ${countOf(scenes.length, 'scene')}.`;
    state.className = '';
    list('scenes', scenes.map(describeScene));
    list('localizers', localizers.map((one) => `${one.path}: ${(one.size_bytes / 1e6).toFixed(1)} MB, ${one.contract.method ?? one.contract.part}`));
    list('jobs', jobs.slice(0, 10).map(describeJob));
  } catch (error) {
    state.textContent = error.message;
    state.className = 'problem';
  }
}

await refresh();
setInterval(refresh, 3000);
