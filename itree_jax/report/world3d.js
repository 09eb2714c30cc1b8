// The world model, turned by mouse, touch or keys. Plain WebGL 2: nothing is fetched, and the page scrolls past it.
// Data (written by world_figure.py): meshes once each; bodies with mesh, matrix model -> camera frame, colour, kind.
'use strict';
(() => {
  const VERTEX = `#version 300 es
    layout(location = 0) in vec3 X; layout(location = 1) in vec3 N;
    uniform mat4 view, model; out vec3 n, x;
    void main() { vec4 p = model * vec4(X, 1.0); x = p.xyz; n = mat3(model) * N; gl_Position = view * p; }`;
  const FRAGMENT = `#version 300 es
    precision highp float; in vec3 n, x; uniform vec4 colour; uniform vec3 eye; uniform float shade; out vec4 seen;
    void main() {
      float facing = abs(dot(normalize(n + vec3(1e-9)), normalize(eye - x)));
      vec3 c = colour.rgb * mix(1.0, 0.38 + 0.62 * facing, shade);
      seen = vec4(c * colour.a, colour.a);
    }`;
  const FIELD = 0.6, NEAREST = 0.25, FARTHEST = 4, TILT = 1.55;  // [rad], shares of the first distance, [rad]
  const PER_PIXEL = 0.008, PER_KEY = 0.12, STEP = 1.25;  // [rad], [rad], zoom of a key or a button

  const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = a => a.map(v => v / Math.hypot(...a));
  const sum = (...terms) => [0, 1, 2].map(k => terms.reduce((s, [w, a]) => s + w * a[k], 0));
  const times = (A, B) => Float32Array.from({length: 16}, (_, k) =>
    [0, 1, 2, 3].reduce((s, j) => s + A[4 * j + k % 4] * B[4 * (k >> 2) + j], 0));

  function program(gl) {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader); gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  }

  function uploaded(gl, mesh) {
    const put = (target, data) => { const b = gl.createBuffer(); gl.bindBuffer(target, b); gl.bufferData(target, data, gl.STATIC_DRAW); };
    const indices = text => mesh.wide ? new Uint32Array(bytes(text)) : new Uint16Array(bytes(text));
    const arrays = text => {
      const array = gl.createVertexArray(), data = indices(text);
      gl.bindVertexArray(array);
      put(gl.ARRAY_BUFFER, new Float32Array(bytes(mesh.points)));
      gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
      put(gl.ARRAY_BUFFER, new Int8Array(bytes(mesh.normals)));
      gl.enableVertexAttribArray(1); gl.vertexAttribPointer(1, 3, gl.BYTE, true, 4, 0);
      put(gl.ELEMENT_ARRAY_BUFFER, data);
      return {array, count: data.length, type: mesh.wide ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT};
    };
    return {faces: arrays(mesh.triangles), lines: arrays(mesh.edges)};
  }

  function start(root) {
    const data = JSON.parse(root.querySelector('script[type="application/json"]').textContent);
    const canvas = root.querySelector('canvas'), told = root.querySelector('output'), at = name => gl.getUniformLocation(shader, name);
    const gl = canvas.getContext('webgl2', {antialias: true, alpha: true});
    if (!gl) return;  // the still picture stays
    const shader = program(gl), meshes = data.meshes.map(mesh => uploaded(gl, mesh));
    const uniform = Object.fromEntries(['view', 'model', 'colour', 'eye', 'shade'].map(name => [name, at(name)]));
    const up = unit(data.up), first = unit(data.toward), hidden = new Set();
    const aside = unit(cross(up, first)), front = cross(aside, up);  // azimuth 0 looks against `front`
    const home = {turn: 0, tilt: Math.asin(dot(first, up)), zoom: data.zoom}, pose = {...home};
    const distance = data.radius / Math.sin(FIELD / 2);
    let picked = -1, waiting = false;
    const labels = data.bodies.map(body => {
      if (!body.label) return null;
      const mark = document.createElement('b');
      mark.textContent = body.label; mark.style.cssText = `background:${body.css};color:${body.ink}`;
      return root.querySelector('.stage').appendChild(mark);
    });

    function view(width, height) {
      const across = sum([Math.cos(pose.turn), front], [Math.sin(pose.turn), aside]);
      const back = sum([Math.cos(pose.tilt), across], [Math.sin(pose.tilt), up]), right = unit(cross(up, back)), top = cross(back, right);
      const far = distance / pose.zoom, eye = sum([1, data.centre], [far, back]);
      const wide = Math.max(width / height, 1e-3), f = Math.min(1, wide / data.zoom) / Math.tan(FIELD / 2);  // all of it fits a narrow canvas too
      const near = Math.max(far - 2.5 * data.radius, far / 50), end = far + 2.5 * data.radius, rows = [right, top, back];
      const W = Float32Array.from({length: 16}, (_, k) => k < 12 ? (k % 4 < 3 ? rows[k % 4][k >> 2] : 0) : k < 15 ? -dot(rows[k - 12], eye) : 1);
      const P = new Float32Array([f / wide, 0, 0, 0, 0, f, 0, 0, 0, 0, (end + near) / (near - end), -1, 0, 0, 2 * end * near / (near - end), 0]);
      return {matrix: times(P, W), eye};
    }

    function paint({matrix, eye}, colourOf) {
      gl.useProgram(shader); gl.enable(gl.DEPTH_TEST); gl.depthMask(true);
      gl.clearColor(0, 0, 0, 0); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniformMatrix4fv(uniform.view, false, matrix); gl.uniform3fv(uniform.eye, eye);
      const piece = ({array, count, type}, mode, colour, shade) => {
        gl.bindVertexArray(array); gl.uniform4fv(uniform.colour, colour); gl.uniform1f(uniform.shade, shade);
        if (count) gl.drawElements(mode, count, type, 0);
      };
      const css = getComputedStyle(canvas).color.match(/[\d.]+/g).slice(0, 3).map(v => v / 255);
      for (const translucent of [false, true]) {
        gl.depthMask(!translucent || !!colourOf);
        data.bodies.forEach((body, k) => {
          if (hidden.has(body.kind) || (body.alpha < 1) !== translucent) return;
          gl.uniformMatrix4fv(uniform.model, false, body.T);
          const {faces, lines} = meshes[body.mesh];
          gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(1, 1);  // edges lie on the faces
          if (body.alpha > 0) piece(faces, gl.TRIANGLES, colourOf ? colourOf(k) : [...body.colour, body.alpha], colourOf ? 0 : 1);
          gl.disable(gl.POLYGON_OFFSET_FILL);
          const edge = body.alpha === 0 ? [...(body.ownLine ? body.colour : css), 1] : [...(k === picked ? css : body.edge), k === picked ? 1 : body.alpha < 1 ? 0.9 : 0.75];
          if (!colourOf) piece(lines, gl.LINES, edge, 0);
        });
      }
    }

    function draw() {
      waiting = false;
      const scale = Math.min(window.devicePixelRatio || 1, 2), {clientWidth: w, clientHeight: h} = canvas;
      if (!w || !h) return;
      canvas.width = Math.round(w * scale); canvas.height = Math.round(h * scale);
      gl.viewport(0, 0, canvas.width, canvas.height); gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      const now = view(w, h);
      paint(now, null);
      labels.forEach((mark, k) => {
        if (!mark) return;
        const X = [...data.bodies[k].centre, 1], p = [0, 1, 3].map(r => X.reduce((s, v, c) => s + now.matrix[4 * c + r] * v, 0));
        mark.style.transform = `translate(-50%, -50%) translate(${w * (1 + p[0] / p[2]) / 2}px, ${h * (1 - p[1] / p[2]) / 2}px)`;
        mark.hidden = hidden.has(data.bodies[k].kind);
      });
    }
    const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

    function bodyAt(event) {
      const box = canvas.getBoundingClientRect(), scale = canvas.width / box.width, pixel = new Uint8Array(4);
      gl.disable(gl.BLEND);
      paint(view(box.width, box.height), k => [((k + 1) & 255) / 255, ((k + 1) >> 8) / 255, 0, 1]);
      gl.readPixels((event.clientX - box.left) * scale, canvas.height - 1 - (event.clientY - box.top) * scale, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      draw();
      return pixel[3] ? pixel[0] + 256 * pixel[1] - 1 : -1;
    }
    function tell(k) {
      if (k === picked) return;
      picked = k;
      const body = data.bodies[k];
      told.replaceChildren();
      if (body) {
        const name = document.createElement(body.link ? 'a' : 'b');
        name.textContent = body.name; if (body.link) name.href = body.link;
        told.append(name, ` ${body.note}`);
      }
      redraw();
    }
    function turn(right, down) { pose.turn -= right; pose.tilt = Math.max(-TILT, Math.min(TILT, pose.tilt + down)); redraw(); }
    function zoom(by) { pose.zoom = Math.max(NEAREST, Math.min(FARTHEST, pose.zoom * by)); redraw(); }

    const fingers = new Map();
    let moved = 0;
    canvas.addEventListener('pointerdown', e => {
      fingers.set(e.pointerId, [e.clientX, e.clientY]); moved = 0;
      try { canvas.setPointerCapture(e.pointerId); } catch { /* a scripted event has no pointer to capture */ }
    });
    canvas.addEventListener('pointermove', e => {
      const before = fingers.get(e.pointerId);
      if (!before) { if (e.pointerType === 'mouse') tell(bodyAt(e)); return; }
      const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      const apart = fingers.size === 2 ? spread() : 0, [dx, dy] = [e.clientX - before[0], e.clientY - before[1]];
      fingers.set(e.pointerId, [e.clientX, e.clientY]); moved += Math.hypot(dx, dy);
      turn(dx * PER_PIXEL / fingers.size, dy * PER_PIXEL / fingers.size);
      if (apart) zoom(spread() / apart);
    });
    canvas.addEventListener('pointerup', e => { fingers.delete(e.pointerId); if (moved < 5) tell(bodyAt(e)); });
    canvas.addEventListener('pointercancel', e => fingers.delete(e.pointerId));
    canvas.addEventListener('wheel', e => { if (e.ctrlKey || e.metaKey) { e.preventDefault(); zoom(Math.exp(-0.002 * e.deltaY)); } }, {passive: false});
    const keys = {ArrowLeft: () => turn(-PER_KEY, 0), ArrowRight: () => turn(PER_KEY, 0), ArrowUp: () => turn(0, -PER_KEY), ArrowDown: () => turn(0, PER_KEY), '+': () => zoom(STEP), '-': () => zoom(1 / STEP)};
    canvas.addEventListener('keydown', e => { if (keys[e.key]) { e.preventDefault(); keys[e.key](); } });
    const buttons = {nearer: () => zoom(STEP), farther: () => zoom(1 / STEP), home: () => { Object.assign(pose, home); redraw(); }, above: () => { Object.assign(pose, {...home, tilt: TILT}); redraw(); }};
    for (const button of root.querySelectorAll('button')) button.addEventListener('click', buttons[button.name]);
    for (const box of root.querySelectorAll('input')) box.addEventListener('change', () => { box.checked ? hidden.delete(box.name) : hidden.add(box.name); redraw(); });
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
    root.classList.add('alive');  // the canvas takes the still picture's place
    new ResizeObserver(redraw).observe(canvas);
  }
  for (const root of document.querySelectorAll('.world3d')) start(root);
})();
