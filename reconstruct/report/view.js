// The view of a report that can be turned. It reads #scene-facts and #scene-data, as
// reconstruct/report/scene.h writes them, draws into #view, and tells there how that went:
// data-state "ready" or "off", data-triangles (drawn), data-filled (share of the pixels that show
// the object), data-colouring, data-toward (direction to the eye, object frame).
(function () {
  'use strict';
  const view = document.getElementById('view');
  const stage = view.querySelector('.stage');
  const facts = JSON.parse(document.getElementById('scene-facts').textContent);

  function give_up(sentence) {
    view.dataset.state = 'off';
    view.querySelector('.off').textContent = sentence;
  }

  // ---- what the page holds ----

  function bytes_of(text) {
    const raw = atob(text);
    const bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) bytes[i] = raw.charCodeAt(i);
    return bytes;
  }

  function unpack(bytes) {
    const count = facts.vertices;
    const data = new DataView(bytes.buffer);
    const places = new Float32Array(3 * count), normals = new Float32Array(3 * count);
    let at = 0;
    for (let i = 0; i < 3 * count; ++i, at += 2)
      places[i] = facts.low_mm[i % 3] + facts.step_mm[i % 3] * data.getUint16(at, true);
    for (let i = 0; i < count; ++i, at += 4) {
      let x = data.getInt16(at, true) / 32767, y = data.getInt16(at + 2, true) / 32767;
      const z = 1 - Math.abs(x) - Math.abs(y);
      if (z < 0) {
        const fold = 1 - Math.abs(y);
        y = (1 - Math.abs(x)) * (y < 0 ? -1 : 1);
        x = fold * (x < 0 ? -1 : 1);
      }
      const size = Math.hypot(x, y, z);
      normals.set([x / size, y / size, z / size], 3 * i);
    }
    const shares = facts.colourings.map((colouring) => {
      if (colouring.stops.length === 0) return null;
      at += count;
      return bytes.subarray(at - count, at);
    });
    const corners = new Uint32Array(3 * facts.triangles);
    let named = 0;
    for (let i = 0; i < corners.length; ++i) {
      let below = 0, shift = 0, byte = 0;
      do {
        byte = bytes[at++];
        below |= (byte & 127) << shift;
        shift += 7;
      } while (byte & 128);
      corners[i] = named - below;
      if (below === 0) ++named;
    }
    return { places, normals, shares, corners };
  }

  /** Red, green, blue, 0 … 255, of each of the 256 bytes that a share may be. */
  function palette(stops) {
    const table = new Uint8Array(3 * 256);
    for (let i = 0; i < 256; ++i) {
      const along = i / 254 * (stops.length - 1);
      const low = Math.min(Math.floor(along), stops.length - 2);
      for (let k = 0; k < 3; ++k) {
        const value = i === 255 ? facts.not_observed[k]
          : stops[low][k] + (along - low) * (stops[low + 1][k] - stops[low][k]);
        table[3 * i + k] = Math.round(255 * value);
      }
    }
    return table;
  }

  function css(colour) {
    return 'rgb(' + colour.map((part) => Math.round(255 * part)).join(',') + ')';
  }

  // ---- the scene ----

  if (facts.triangles === 0) return give_up('The mesh is empty: there is nothing to turn.');
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch (error) {
    return give_up('This browser offers no WebGL, so the object cannot be turned here. ' +
                   'The pictures below show it from six sides.');
  }
  const object = unpack(bytes_of(document.getElementById('scene-data').textContent));
  const geometry = new THREE.BufferGeometry();
  const tint = new THREE.BufferAttribute(new Uint8Array(3 * facts.vertices), 3, true);
  geometry.setAttribute('position', new THREE.BufferAttribute(object.places, 3));
  geometry.setAttribute('normal', new THREE.BufferAttribute(object.normals, 3));
  geometry.setAttribute('tint', tint);
  geometry.setIndex(new THREE.BufferAttribute(object.corners, 1));
  geometry.computeBoundingSphere();
  const centre = geometry.boundingSphere.center.clone();
  const radius = Math.max(geometry.boundingSphere.radius, 1e-6);

  // Lit as the still pictures are (draw.cc): from above the viewer's left shoulder.
  const material = new THREE.ShaderMaterial({
    side: THREE.DoubleSide,
    uniforms: { relief: { value: 1 } },
    vertexShader: `
      attribute vec3 tint;
      varying vec3 colour, normal_of_eye;
      void main() {
        colour = tint;
        normal_of_eye = normalMatrix * normal;
        gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      }`,
    fragmentShader: `
      uniform float relief;
      varying vec3 colour, normal_of_eye;
      void main() {
        vec3 n = normalize(normal_of_eye);
        float key = max(0.0, dot(n, normalize(vec3(-0.45, 0.65, 0.75))));
        float fill = max(0.0, dot(n, normalize(vec3(0.7, -0.1, 0.5))));
        float rim = pow(1.0 - clamp(n.z, 0.0, 1.0), 3.0);
        float shaded = clamp(0.30 + 0.68 * key + 0.16 * fill - 0.12 * rim, 0.0, 1.1);
        gl_FragColor = vec4((1.0 - relief * (1.0 - shaded)) * colour, 1.0);
      }`,
  });
  const scene = new THREE.Scene();
  scene.add(new THREE.Mesh(geometry, material));
  const camera = new THREE.PerspectiveCamera(24, 1, 1, 10);
  camera.up.set(0, 0, 1);
  const canvas = renderer.domElement;
  canvas.tabIndex = 0;
  canvas.setAttribute('role', 'img');
  canvas.setAttribute('aria-label', 'The object; arrow keys turn it, plus and minus zoom');
  stage.prepend(canvas);

  // ---- the eye: on a sphere about a target, z up ----

  const kSteepest = Math.PI / 2 - 1e-3;
  const start = { turn: -0.6, rise: 0.32, away: 1, target: centre.clone() };
  const eye = { turn: start.turn, rise: start.rise, away: 1, target: centre.clone() };
  let nearest_fit = 1;  // mm from which the whole object is seen; `away` is in these
  let is_asked = false;

  function toward_eye() {
    const flat = Math.cos(eye.rise);
    return new THREE.Vector3(flat * Math.sin(eye.turn), -flat * Math.cos(eye.turn),
                             Math.sin(eye.rise));
  }

  function pixels_per_mm() {
    return canvas.clientHeight /
      (2 * eye.away * nearest_fit * Math.tan(camera.fov * Math.PI / 360));
  }

  function show_scale() {
    // The longest of 1, 2, 5 × 10ⁿ mm that is no wider than 120 pixels, at the target's depth.
    const most = 120 / pixels_per_mm();
    const ten = Math.pow(10, Math.floor(Math.log10(most)));
    const mm = ten * [5, 2, 1].find((step) => step * ten <= most);
    const scale = view.querySelector('.scale');
    scale.style.width = (mm * pixels_per_mm()).toFixed(1) + 'px';
    scale.textContent = mm >= 0.1 ? +mm.toPrecision(1) + ' mm' : +(1000 * mm).toPrecision(1) + ' µm';
  }

  function draw() {
    is_asked = false;
    const toward = toward_eye();
    const away = eye.away * nearest_fit;
    camera.position.copy(eye.target).addScaledVector(toward, away);
    camera.lookAt(eye.target);
    const reach = radius + eye.target.distanceTo(centre);
    camera.near = Math.max(away - reach, away / 1000);
    camera.far = away + reach;
    camera.updateProjectionMatrix();
    renderer.render(scene, camera);
    view.dataset.triangles = renderer.info.render.triangles;
    view.dataset.toward = toward.toArray().map((part) => part.toFixed(3)).join(' ');
    show_scale();
  }

  function ask() {
    if (!is_asked) requestAnimationFrame(draw);
    is_asked = true;
  }

  function fit() {
    const width = stage.clientWidth, height = stage.clientHeight;
    if (width === 0 || height === 0) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    const half = camera.fov * Math.PI / 360;
    nearest_fit = 1.04 * radius / Math.sin(Math.min(half, Math.atan(camera.aspect * Math.tan(half))));
    ask();
  }

  function turn(right, up) {
    eye.turn += right;
    eye.rise = Math.min(Math.max(eye.rise + up, -kSteepest), kSteepest);
    ask();
  }

  function zoom(factor) {
    eye.away = Math.min(Math.max(eye.away * factor, 0.02), 4);
    ask();
  }

  function move(right_px, down_px) {
    const right = new THREE.Vector3().setFromMatrixColumn(camera.matrix, 0);
    const up = new THREE.Vector3().setFromMatrixColumn(camera.matrix, 1);
    eye.target.addScaledVector(right, -right_px / pixels_per_mm());
    eye.target.addScaledVector(up, down_px / pixels_per_mm());
    eye.target.sub(centre).clampLength(0, 2 * radius).add(centre);
    ask();
  }

  /** Goes to a place of the eye the short way round, at once for whoever wants no motion. */
  function go_to(place) {
    const from = { turn: eye.turn, rise: eye.rise, away: eye.away, target: eye.target.clone() };
    const round = 2 * Math.PI;
    const way = place.turn - from.turn - round * Math.round((place.turn - from.turn) / round);
    const is_still = window.matchMedia('(prefers-reduced-motion: reduce)').matches;
    const duration_ms = is_still ? 0 : 350;
    let begun = null;
    function step(now) {
      if (begun === null) begun = now;
      const passed = duration_ms > 0 ? Math.min((now - begun) / duration_ms, 1) : 1;
      const share = passed * passed * (3 - 2 * passed);
      eye.turn = from.turn + share * way;
      eye.rise = from.rise + share * (place.rise - from.rise);
      eye.away = from.away + share * (place.away - from.away);
      eye.target.lerpVectors(from.target, place.target, share);
      ask();
      if (passed < 1) requestAnimationFrame(step);
    }
    requestAnimationFrame(step);
  }

  // ---- mouse, touch, keys ----

  const pointers = new Map();
  const kTurn_rad_per_px = 0.008;

  function spread() {
    const [a, b] = Array.from(pointers.values());
    return { size: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  }

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.focus({ preventScroll: true });
  });
  canvas.addEventListener('pointermove', (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = pointers.size === 2 ? spread() : null;
    const dx = event.clientX - last.x, dy = event.clientY - last.y;
    last.x = event.clientX;
    last.y = event.clientY;
    if (before) {
      const after = spread();
      if (after.size > 0) zoom(before.size / after.size);
      move(after.x - before.x, after.y - before.y);
    } else if (pointers.size === 1) {
      if (event.shiftKey || (event.buttons & 6) !== 0) move(dx, dy);
      else turn(-kTurn_rad_per_px * dx, kTurn_rad_per_px * dy);
    }
  });
  for (const name of ['pointerup', 'pointercancel'])
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('wheel', (event) => {
    // Who scrolls past the view wants the page, not the object.
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    const lines_px = event.deltaMode === 1 ? 16 : 1;
    zoom(Math.exp(0.0012 * lines_px * event.deltaY));
  }, { passive: false });
  canvas.addEventListener('dblclick', () => go_to(start));

  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
    ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
    '+': () => zoom(1 / 1.15), '=': () => zoom(1 / 1.15), '-': () => zoom(1.15),
    '0': () => go_to(start),
  };
  const moves = {
    ArrowLeft: () => move(-24, 0), ArrowRight: () => move(24, 0),
    ArrowUp: () => move(0, -24), ArrowDown: () => move(0, 24),
  };
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const act = (event.shiftKey && moves[event.key]) || keys[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });

  // ---- the panel: colours with their legend, sides ----

  function colour_by(index) {
    const colouring = facts.colourings[index], shares = object.shares[index];
    const array = tint.array;
    if (shares) {
      const table = palette(colouring.stops);
      for (let i = 0; i < shares.length; ++i) {
        const from = 3 * shares[i];
        array[3 * i] = table[from];
        array[3 * i + 1] = table[from + 1];
        array[3 * i + 2] = table[from + 2];
      }
    } else {
      const clay = facts.clay.map((part) => Math.round(255 * part));
      for (let i = 0; i < array.length; ++i) array[i] = clay[i % 3];
    }
    tint.needsUpdate = true;
    material.uniforms.relief.value = colouring.relief;

    const legend = view.querySelector('.legend');
    legend.classList.toggle('none', !shares);  // keeps its room: nothing jumps
    if (shares) {
      legend.querySelector('.flat').style.background =
        'linear-gradient(to right,' + colouring.stops.map(css).join(',') + ')';
      legend.querySelectorAll('.ends span').forEach((end, i) => {
        end.textContent = colouring.labels[i];
      });
      legend.querySelector('.grey').hidden = shares.indexOf(255) < 0;
    }
    view.querySelector('.explained').textContent = colouring.explained;
    view.dataset.colouring = colouring.name;
    ask();
  }

  facts.colourings.forEach((colouring, index) => {
    const label = document.createElement('label'), input = document.createElement('input');
    input.type = 'radio';
    input.name = 'colouring';
    input.checked = index === 0;
    input.addEventListener('change', () => colour_by(index));
    label.append(input, document.createTextNode(colouring.name));
    view.querySelector('.colourings').append(label);
  });
  facts.views.forEach((side) => {
    const button = document.createElement('button');
    button.type = 'button';
    button.textContent = side.name;
    const [x, y, z] = side.toward;
    // Seen from straight above or below, `up` says which way is up.
    const is_level = Math.abs(z) < 0.5;
    const place = {
      turn: is_level ? Math.atan2(x, -y)
        : Math.atan2(-Math.sign(z) * side.up[0], Math.sign(z) * side.up[1]),
      rise: is_level ? 0 : Math.sign(z) * kSteepest,
      away: 1,
      target: centre,
    };
    button.addEventListener('click', () => go_to(place));
    view.querySelector('.sides').append(button);
  });

  // ---- begin ----

  canvas.addEventListener('webglcontextlost', () =>
    give_up('The graphics of this browser gave up. Reload the page to turn the object again.'));
  view.dataset.state = 'ready';  // the stage has its size from here on
  fit();
  colour_by(0);
  draw();
  // Some drivers draw nothing and say nothing.
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
  gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE,
                pixels);
  let filled = 0;
  for (let i = 3; i < pixels.length; i += 4) filled += pixels[i] > 0 ? 1 : 0;
  view.dataset.filled = (4 * filled / pixels.length).toFixed(4);
  if (filled === 0)
    return give_up('The graphics of this browser drew nothing. ' +
                   'The pictures below show the object from six sides.');
  if (window.ResizeObserver) new ResizeObserver(fit).observe(stage);
  else window.addEventListener('resize', fit);
}());
